#include "core/udpm_guard.h"

#include <dirent.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "core/bus.h"
#include "core/log.h"

namespace teres {
namespace {

constexpr std::uint32_t kMagicShort = 0x4c433032, kMagicFragment = 0x4c433033;  // "LC02", "LC03"
constexpr std::uint32_t kUdpHeader = 8;  // a socket filter sees the packet from the UDP header on
// LC02: magic, sequence, channel. LC03: magic, sequence, size of the message, offset of the fragment, u16 number, u16
// count, and in fragment 0 the channel.
constexpr std::uint32_t kAtMagic = kUdpHeader, kAtShortChannel = kUdpHeader + 8;
constexpr std::uint32_t kAtSize = kUdpHeader + 8, kAtOffset = kUdpHeader + 12, kAtNumber = kUdpHeader + 16,
                        kAtCount = kUdpHeader + 18, kAtFragmentChannel = kUdpHeader + 20;
constexpr std::uint32_t kMaxChannel = 64;  // with its terminating zero

constexpr sock_filter kAccept = BPF_STMT(BPF_RET | BPF_K, 0xffffffff), kDrop = BPF_STMT(BPF_RET | BPF_K, 0);
constexpr sock_filter load(std::uint16_t width, std::uint32_t at) {  // behind the end of the packet: drops it
    return BPF_STMT(static_cast<std::uint16_t>(BPF_LD | BPF_ABS | width), at);
}

void accept_if_channel_ends(std::vector<sock_filter>& program, std::uint32_t at) {
    for (std::uint32_t i = 0; i < kMaxChannel; ++i) {
        program.push_back(load(BPF_B, at + i));
        program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 0, 1));
        program.push_back(kAccept);
    }
    program.push_back(kDrop);
}

bool attach_packet_filter(int fd) {
    std::vector<sock_filter> program = {
        load(BPF_W, kAtMagic),  // of a fragment: behind the part for whole messages
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kMagicFragment, 0, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kMagicShort, 1, 0),
        kDrop,
    };
    std::vector<sock_filter> fragment = {
        load(BPF_W, kAtSize),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, kMaxMessageBytes, 3, 0),
        BPF_STMT(BPF_MISC | BPF_TAX, 0),
        load(BPF_W, kAtOffset),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_X, 0, 0, 1),  // offset > size
        kDrop,
        load(BPF_H, kAtCount),  // the header is whole
        load(BPF_H, kAtNumber),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, 0, 1, 0),
        kAccept,
    };
    accept_if_channel_ends(fragment, kAtFragmentChannel);
    std::vector<sock_filter> whole;
    accept_if_channel_ends(whole, kAtShortChannel);
    program[1].jt = static_cast<std::uint8_t>(2 + whole.size());
    program.insert(program.end(), whole.begin(), whole.end());
    program.insert(program.end(), fragment.begin(), fragment.end());
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
        if (attach_packet_filter(fd)) ++guard.filtered;
        int size = 0;
        socklen_t length = sizeof size;
        if (getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &size, &length) == 0) {
            const long usable = size / 2;  // the kernel doubles the request for its own book-keeping
            guard.recv_buffer = std::min(guard.recv_buffer.value_or(usable), usable);
        }
    }
    if (guard.sockets == 0 || guard.filtered < guard.sockets)
        log(Level::kWarn, "bus",
            "no packet filter on the LCM socket: a malformed packet can crash liblcm; keep the udp port "
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
