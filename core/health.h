// What the HEALTH message says: traffic per channel, step times per unit, memory, loop time. Bounded: at most
// kMaxChannels channels are told apart, the rest is counted under "(other)".
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/hosted_unit.h"
#include "teres/health_t.hpp"

namespace teres {

class TrafficBook {
  public:
    static constexpr std::size_t kMaxChannels = 64;

    /// [loop] A message that reached a unit. Dropped ones show as gaps in its sequence number; a sequence
    /// that runs backwards is a new publisher.
    void received(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept;
    /// [loop] A message that a unit sent; counts only as long as no unit here receives that channel.
    void sent(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept;
    /// [loop] A message that was refused (too large, queue full).
    void refused(std::string_view channel) noexcept;
    /// [loop] Rates are taken over the time since the last call.
    void report(std::vector<channel_health_t>& to, std::int64_t now_us);

  private:
    struct Traffic {
        std::int64_t received = 0;
        std::int64_t dropped = 0;
        std::int64_t received_before = 0;  // at the last report
        std::int64_t last_us = -1;
        std::int64_t last_sequence = -1;
        bool heard = false;  // a unit here receives it
    };
    static void count(Traffic& traffic, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept;
    Traffic* entry(std::string_view channel) noexcept;

    std::map<std::string, Traffic, std::less<>> channels_;
    std::int64_t reported_us_ = -1;
};

/// Resident and peak memory of this process.
class MemoryReader {
  public:
    MemoryReader();
    ~MemoryReader();
    MemoryReader(const MemoryReader&) = delete;
    MemoryReader& operator=(const MemoryReader&) = delete;
    double resident_mb() const noexcept;  ///< [loop] negative if unknown
    double peak_mb() const noexcept;      ///< [loop]

  private:
    int statm_ = -1;
};

/// Word for the state of a unit in HEALTH; see unit_health.lcm.
const char* state_word(const HostedUnit& unit, std::int64_t now_us, std::int64_t stale_after_us) noexcept;

}  // namespace teres
