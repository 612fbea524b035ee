// What `teres spy` knows of the traffic: per channel rate, bytes, jitter, gaps in the sequence, age, type,
// newest message. Bounded: at most kMaxChannels channels are told apart, the rest counts as "(other)".
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace teres::tools {

struct SpyRow {
    std::string channel;
    std::int64_t messages = 0, bytes = 0;
    double rate_hz = 0.0;  ///< of the last 64 messages; falls when the channel goes silent
    double bytes_per_s = 0.0;
    double jitter_ms = 0.0;     ///< standard deviation of the intervals of the last 64 messages
    double age_s = 0.0;         ///< since the newest message
    std::int64_t lost = 0;      ///< sum of the gaps in the sequence number (types of core/messages)
    std::int64_t restarts = 0;  ///< sequence numbers that ran backwards
    std::string type;
    nlohmann::json fields;  ///< of the newest message
};

class SpyTable {
  public:
    static constexpr std::size_t kMaxChannels = 256;

    /// [loop] `now_us`: monotonic clock.
    void add(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us);
    std::vector<SpyRow> rows(std::int64_t now_us) const;
    std::int64_t messages() const { return messages_; }

  private:
    static constexpr std::size_t kRing = 64;
    static constexpr std::size_t kMaxKept = 1 << 20;  // a larger newest message is shown by its type only
    struct Arrival {
        std::int64_t at_us = 0;
        std::size_t bytes = 0;
    };
    struct Traffic {
        std::int64_t messages = 0, bytes = 0, lost = 0, restarts = 0;
        std::optional<std::int64_t> sequence;
        std::array<Arrival, kRing> arrivals{};  // ring, newest at (messages - 1) % kRing
        std::vector<std::uint8_t> newest;
    };
    static SpyRow row(const std::string& channel, const Traffic& traffic, std::int64_t now_us);

    std::map<std::string, Traffic, std::less<>> channels_;
    std::int64_t messages_ = 0;
};

/// Lines of at most `columns` characters: heading, one line a channel, and below it the decoded fields.
std::string as_text(const std::vector<SpyRow>& rows, std::size_t columns);
/// {"channels":[{"channel":..,"rate_hz":..,...}]} in one line.
std::string as_json(const std::vector<SpyRow>& rows);

}  // namespace teres::tools
