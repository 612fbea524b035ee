// Books of a replay: what was published, its fingerprint, and how it compares with the results that the log
// holds.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/channel_pattern.h"
#include "core/result.h"
#include "core/run_hash.h"

namespace teres::tools {

/// What a replay feeds, what plugins publish themselves, and what no comparison can be made of.
inline constexpr const char* kInputChannels = "MARKERS|TOOL_LOADS|CUT|CAMERA_.*|PEDAL";
inline constexpr const char* kResultChannels = "BOUNDARY_ESTIMATE|LIVER_STATE|INNOVATION|GAP";
inline constexpr const char* kHealthChannel = "HEALTH";
inline constexpr const char* kEstimateChannel = "BOUNDARY_ESTIMATE";

class ReplayBook {
  public:
    struct Traffic {
        std::int64_t messages = 0, bytes = 0;
        bool input = false;
    };
    struct Comparison {
        std::string channel;
        std::int64_t recorded = 0, replayed = 0, identical = 0;  ///< identical: same bytes at the same place
    };

    ReplayBook();
    /// [setup] Fingerprints of the results in a log, for compare(). Errors: as LogReader::open.
    Status read_results(const std::filesystem::path& log);
    /// [loop] received_us: on the monotonic clock.
    void add(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t received_us);
    /// From the capture stamp of a frame to its published estimate [ms], at `speed` times real time (> 0): the share
    /// `quantile` of the frames took no longer. The recording's clock is set by its first input. NaN: no estimates.
    double latency_ms(double quantile, double speed) const;

    std::string hash() const { return hash_.text(); }
    std::int64_t messages() const { return messages_; }
    /// From the first to the newest capture stamp of the inputs [s].
    double recorded_s() const { return static_cast<double>(newest_us_ - first_us_) * 1e-6; }
    const std::map<std::string, Traffic, std::less<>>& channels() const { return channels_; }
    std::vector<Comparison> compare() const;

  private:
    ChannelPattern inputs_, results_;
    RunHash hash_;
    std::int64_t messages_ = 0;
    bool stamped_ = false;
    std::int64_t first_us_ = 0, newest_us_ = 0, first_received_us_ = 0;
    std::vector<std::pair<std::int64_t, std::int64_t>> estimates_;  // capture stamp, received [us]
    std::map<std::string, Traffic, std::less<>> channels_;
    std::map<std::string, std::vector<std::uint64_t>, std::less<>> recorded_,
        replayed_;  // one hash a message
};

}  // namespace teres::tools
