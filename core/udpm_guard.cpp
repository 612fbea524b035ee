#include "core/udpm_guard.h"

#include <dirent.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "core/bus.h"
#include "core/log.h"

namespace teres {
namespace {

constexpr std::uint32_t kMagicFragment = 0x4c433033;  // "LC03"
constexpr std::uint32_t kUdpHeader = 8;  // a socket filter sees the packet from the UDP header on
// Offsets in a fragment's header: magic, sequence, size of the message, offset of the fragment, ...
constexpr std::uint32_t kAtMagic = kUdpHeader, kAtSize = kUdpHeader + 8, kAtOffset = kUdpHeader + 12;

bool attach_fragment_filter(int fd) {
    std::array<sock_filter, 9> program = {{
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kAtMagic),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kMagicFragment, 0, 5),  // other packets: accept
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kAtSize),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, kMaxMessageBytes, 4, 0),  // size above our bound: drop
        BPF_STMT(BPF_MISC | BPF_TAX, 0),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, kAtOffset),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_X, 0, 1, 0),  // offset > size: drop
        BPF_STMT(BPF_RET | BPF_K, 0xffffffff),
        BPF_STMT(BPF_RET | BPF_K, 0),
    }};
    sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
    return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

bool is_udp_on_port(int fd, int port) {
    int type = 0;
    socklen_t length = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) != 0 || type != SOCK_DGRAM) return false;
    sockaddr_in address{};
    length = sizeof address;
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0) return false;
    return address.sin_family == AF_INET && ntohs(address.sin_port) == port;
}

std::vector<int> open_descriptors() {
    std::vector<int> found;
    DIR* folder = opendir("/proc/self/fd");
    if (folder == nullptr) return found;
    while (const dirent* entry = readdir(folder))
        if (entry->d_name[0] != '.') found.push_back(std::atoi(entry->d_name));
    closedir(folder);
    return found;
}

}  // namespace

UdpmUrl parse_udpm_url(const std::string& url) {
    UdpmUrl parsed;
    std::string_view rest(url);
    rest.remove_prefix(std::min(rest.size(), std::string_view("udpm://").size()));
    const std::string target(rest.substr(0, rest.find('?')));
    if (const auto colon = target.find(':'); colon != std::string::npos)
        parsed.port = std::atoi(target.c_str() + colon + 1);
    if (const auto at = url.find("recv_buf_size="); at != std::string::npos)
        parsed.recv_buf_size = std::atol(url.c_str() + at + std::string_view("recv_buf_size=").size());
    return parsed;
}

UdpmGuard guard_udpm_socket(const std::string& url) {
    const UdpmUrl wanted = parse_udpm_url(url);
    UdpmGuard guard;
    for (const int fd : open_descriptors()) {
        if (!is_udp_on_port(fd, wanted.port)) continue;
        ++guard.sockets;
        if (attach_fragment_filter(fd)) ++guard.filtered;
        int size = 0;
        socklen_t length = sizeof size;
        if (getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &size, &length) == 0) {
            const long usable = size / 2;  // the kernel doubles the request for its own book-keeping
            guard.recv_buffer = std::min(guard.recv_buffer.value_or(usable), usable);
        }
    }
    if (guard.sockets == 0 || guard.filtered < guard.sockets)
        log(Level::kWarn, "bus",
            "no packet filter on the LCM socket: a malformed fragment can crash liblcm; keep the udp port "
            "closed to other hosts");
    constexpr long kEnough = 1 << 20;  // 1 MiB carried 30 Hz VGA colour and depth without loss
    if (guard.recv_buffer && *guard.recv_buffer < wanted.recv_buf_size.value_or(kEnough))
        log(Level::kWarn, "bus",
            "LCM receive buffer is " + std::to_string(*guard.recv_buffer) + " bytes, " +
                (wanted.recv_buf_size ? "the url asks for " + std::to_string(*wanted.recv_buf_size)
                                      : std::to_string(kEnough) + " are needed for images") +
                ": messages will be lost; remedy: `sysctl -w net.core.rmem_max=33554432 "
                "net.core.rmem_default=4194304` "
                "and udpm://...?recv_buf_size=16777216");
    return guard;
}

}  // namespace teres
