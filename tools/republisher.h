// One-way window onto the bus: messages go out as LCM multicast packets by one chosen interface, and nothing is ever
// received from there: the socket has no port that listens and is never read. What a slow or hostile laptop does cannot
// hold up or reach the service.
//
//     small message  "LC02" · sequence u32 · channel\0 · data                             (big-endian, LCM's udpm
//     format) fragment       "LC03" · sequence u32 · size u32 · offset u32 · number u16 · count u16 · [channel\0] ·
//     data
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace teres::tools {

struct RepublishLimits {
    double bytes_per_s = 1e6;      ///< over all channels
    double messages_per_s = 10.0;  ///< per channel
    std::size_t max_message_bytes = 1 << 20;
};

/// The packets that carry one message.
std::vector<std::vector<std::uint8_t>> udpm_packets(std::string_view channel, std::span<const std::uint8_t> data,
                                                    std::uint32_t sequence);

class Republisher {
  public:
    struct Counters {
        std::int64_t sent = 0, held_back = 0, failed = 0;
    };
    /// Errors (kHostFault): no such interface, no socket. `group`: "239.255.76.68:7668".
    static Result<Republisher> open(const std::string& interface, const std::string& group, int hops,
                                    const RepublishLimits& limits);
    Republisher(Republisher&& other) noexcept;
    Republisher& operator=(Republisher&&) = delete;
    ~Republisher();

    /// Sends or holds back; never waits.
    void message(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us);
    const Counters& counters() const { return counters_; }

  private:
    // Fills with time up to one second's worth; a message takes from it what it costs.
    struct Bucket {
        double level = 0.0;
        std::int64_t filled_us = -1;
        bool take(double cost, double per_s, std::int64_t now_us);
    };
    Republisher(int fd, const RepublishLimits& limits) : fd_(fd), limits_(limits) {}

    static constexpr std::size_t kMaxChannels = 256;
    int fd_;
    RepublishLimits limits_;
    Bucket total_;
    std::map<std::string, Bucket, std::less<>> channels_;
    std::uint32_t sequence_ = 0;
    Counters counters_;
};

}  // namespace teres::tools
