#include "tools/republisher.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <utility>

namespace teres::tools {
namespace {

constexpr std::size_t kShortBytes = 1400;  // one Ethernet frame
constexpr std::size_t kFragmentBytes = 1300;
constexpr std::uint32_t kShortMagic = 0x4c433032, kFragmentMagic = 0x4c433033;

void put(std::vector<std::uint8_t>& to, std::uint32_t value, int bytes) {
    for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) to.push_back(static_cast<std::uint8_t>(value >> shift));
}

void put(std::vector<std::uint8_t>& to, std::string_view channel) {
    to.insert(to.end(), channel.begin(), channel.end());
    to.push_back(0);
}

}  // namespace

std::vector<std::vector<std::uint8_t>> udpm_packets(std::string_view channel, std::span<const std::uint8_t> data,
                                                    std::uint32_t sequence) {
    std::vector<std::vector<std::uint8_t>> packets;
    if (data.size() + channel.size() <= kShortBytes) {
        auto& packet = packets.emplace_back();
        put(packet, kShortMagic, 4);
        put(packet, sequence, 4);
        put(packet, channel);
        packet.insert(packet.end(), data.begin(), data.end());
        return packets;
    }
    const std::size_t in_first = kFragmentBytes - channel.size() - 1;
    const std::size_t count = 1 + (data.size() - std::min(data.size(), in_first) + kFragmentBytes - 1) / kFragmentBytes;
    if (count > 0xffff) return packets;
    for (std::size_t number = 0, offset = 0; number < count; ++number) {
        const std::size_t size = std::min(number == 0 ? in_first : kFragmentBytes, data.size() - offset);
        auto& packet = packets.emplace_back();
        put(packet, kFragmentMagic, 4);
        put(packet, sequence, 4);
        put(packet, static_cast<std::uint32_t>(data.size()), 4);
        put(packet, static_cast<std::uint32_t>(offset), 4);
        put(packet, static_cast<std::uint32_t>(number), 2);
        put(packet, static_cast<std::uint32_t>(count), 2);
        if (number == 0) put(packet, channel);
        packet.insert(packet.end(), data.begin() + static_cast<std::ptrdiff_t>(offset),
                      data.begin() + static_cast<std::ptrdiff_t>(offset + size));
        offset += size;
    }
    return packets;
}

Result<Republisher> Republisher::open(const std::string& interface, const std::string& group, int hops,
                                      const RepublishLimits& limits) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    const std::size_t colon = group.find(':');
    std::uint16_t port = 0;
    const std::string number = colon == std::string::npos ? "" : group.substr(colon + 1);
    const auto read = std::from_chars(number.data(), number.data() + number.size(), port);
    const bool good = read.ec == std::errc{} && read.ptr == number.data() + number.size() && port != 0 &&
                      inet_pton(AF_INET, group.substr(0, colon).c_str(), &to.sin_addr) == 1 &&
                      IN_MULTICAST(ntohl(to.sin_addr.s_addr));
    if (!good) return invalid_input("'" + group + "' is not a multicast ADDRESS:PORT, as 239.255.76.68:7668");
    to.sin_port = htons(port);
    const unsigned index = if_nametoindex(interface.c_str());
    if (index == 0) return host_fault("there is no interface " + interface + "; `ip link` lists them");

    Republisher republisher(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), limits);
    ip_mreqn by{};
    by.imr_ifindex = static_cast<int>(index);
    const int none = 0;
    const int fd = republisher.fd_;
    if (fd < 0 || setsockopt(fd, IPPROTO_IP, IP_MULTICAST_IF, &by, sizeof by) != 0 ||
        setsockopt(fd, IPPROTO_IP, IP_MULTICAST_TTL, &hops, sizeof hops) != 0 ||
        setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &none, sizeof none) != 0 ||
        connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
        return host_fault("interface " + interface + ", group " + group + ": " + std::strerror(errno));
    shutdown(fd, SHUT_RD);
    return republisher;
}

Republisher::Republisher(Republisher&& other) noexcept : fd_(std::exchange(other.fd_, -1)), limits_(other.limits_) {}

Republisher::~Republisher() {
    if (fd_ >= 0) close(fd_);
}

bool Republisher::Bucket::take(double cost, double per_s, std::int64_t now_us) {
    const double room = std::max(per_s, cost);  // one message passes when the bucket has long been full
    level = filled_us < 0 ? room : std::min(room, level + 1e-6 * static_cast<double>(now_us - filled_us) * per_s);
    filled_us = now_us;
    if (level < cost) return false;
    level -= cost;
    return true;
}

void Republisher::message(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) {
    if (data.size() > limits_.max_message_bytes) {
        ++counters_.held_back;
        return;
    }
    auto at = channels_.find(channel);
    if (at == channels_.end() && channels_.size() < kMaxChannels) at = channels_.emplace(channel, Bucket{}).first;
    if (at == channels_.end() || !at->second.take(1.0, limits_.messages_per_s, now_us) ||
        !total_.take(static_cast<double>(data.size()), limits_.bytes_per_s, now_us)) {
        ++counters_.held_back;
        return;
    }
    bool sent = true;
    for (const auto& packet : udpm_packets(channel, data, sequence_++))
        sent = sent && send(fd_, packet.data(), packet.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(packet.size());
    ++(sent ? counters_.sent : counters_.failed);
}

}  // namespace teres::tools
