#include "core/manager_link.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

#include "core/log.h"

namespace teres {

ManagerLink::ManagerLink(bool watchdog) {
    std::uint64_t limit_us = 0;
    if (watchdog && sd_watchdog_enabled(0, &limit_us) > 0) period_us_ = static_cast<std::int64_t>(limit_us / 4);
    const char* path = std::getenv("NOTIFY_SOCKET");
    if (path == nullptr || *path == '\0') return;
    sockaddr_un address{};
    const std::size_t size = std::strlen(path);
    if ((path[0] != '/' && path[0] != '@') || size >= sizeof(address.sun_path)) {
        log(Level::kWarn, "service",
            std::string("NOTIFY_SOCKET '") + path + "' is not a socket path; the manager is told nothing");
        return;
    }
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path, size);
    if (path[0] == '@') address.sun_path[0] = '\0';  // abstract
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + size);
    if (socket_ >= 0 && connect(socket_, reinterpret_cast<const sockaddr*>(&address), length) == 0) return;
    log(Level::kWarn, "service", std::string("NOTIFY_SOCKET '") + path + "': " + std::strerror(errno));
    if (socket_ >= 0) close(socket_);
    socket_ = -1;
}

ManagerLink::~ManagerLink() {
    if (socket_ >= 0) close(socket_);
}

bool ManagerLink::tell(std::string_view text, int wait_ms) noexcept {
    if (socket_ < 0) return true;
    const auto sent = [&] {
        return send(socket_, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
    };
    if (sent()) return true;
    if (errno != EAGAIN || wait_ms <= 0) return false;
    pollfd writable{socket_, POLLOUT, 0};
    return poll(&writable, 1, wait_ms) > 0 && sent();
}

void ManagerLink::ping(std::int64_t now_us) noexcept {
    if (period_us_ < 0 || now_us < next_us_) return;
    if (tell("WATCHDOG=1")) next_us_ = now_us + period_us_;  // otherwise again in the next turn
}

}  // namespace teres
