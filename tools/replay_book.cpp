#include "tools/replay_book.h"

#include <algorithm>
#include <limits>

#include "core/log.h"
#include "core/log_reader.h"
#include "core/message_stamp.h"

namespace teres::tools {
namespace {

std::uint64_t hash_of(std::string_view channel, std::span<const std::uint8_t> data) {
    RunHash hash;
    hash.add(channel, data);
    return hash.value();
}

}  // namespace

ReplayBook::ReplayBook()
    : inputs_(*ChannelPattern::make(kInputChannels)), results_(*ChannelPattern::make(kResultChannels)) {}

Status ReplayBook::read_results(const std::filesystem::path& log) {
    TERES_TRY_ASSIGN(LogReader reader, LogReader::open(log));
    LogEvent event;
    while (reader.next(event)) {
        const std::string channel(event.channel);
        if (results_.matches(channel.c_str())) recorded_[channel].push_back(hash_of(channel, event.data));
    }
    return {};
}

void ReplayBook::add(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t received_us) {
    const std::string name(channel);
    ++messages_;
    Traffic& traffic = channels_[name];
    ++traffic.messages;
    traffic.bytes += static_cast<std::int64_t>(data.size());
    traffic.input = inputs_.matches(name.c_str());
    if (traffic.input) {
        const auto stamp = stamp_of(data);
        if (!stamp) return;
        if (!stamped_) {
            first_us_ = newest_us_ = stamp->capture_us;
            first_received_us_ = received_us;
        }
        stamped_ = true;
        newest_us_ = std::max(newest_us_, stamp->capture_us);
        return;
    }
    if (name == kHealthChannel) return;
    if (name == kEstimateChannel)
        if (const auto stamp = stamp_of(data)) estimates_.emplace_back(stamp->capture_us, received_us);
    hash_.add(channel, data);
    if (recorded_.count(name) > 0) replayed_[name].push_back(hash_of(channel, data));
}

double ReplayBook::latency_ms(double quantile, double speed) const {
    std::vector<double> ms;
    for (const auto& [stamp_us, received_us] : estimates_)
        ms.push_back(1e-3 * (static_cast<double>(received_us - first_received_us_) -
                             static_cast<double>(stamp_us - first_us_) / speed));
    if (ms.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::sort(ms.begin(), ms.end());
    return ms[static_cast<std::size_t>(quantile * static_cast<double>(ms.size() - 1) + 0.5)];
}

std::vector<ReplayBook::Comparison> ReplayBook::compare() const {
    std::vector<Comparison> all;
    for (const auto& [channel, recorded] : recorded_) {
        const auto found = replayed_.find(channel);
        const std::vector<std::uint64_t> none;
        const auto& replayed = found == replayed_.end() ? none : found->second;
        Comparison c{channel, static_cast<std::int64_t>(recorded.size()), static_cast<std::int64_t>(replayed.size()),
                     0};
        for (std::size_t i = 0; i < std::min(recorded.size(), replayed.size()); ++i)
            c.identical += recorded[i] == replayed[i] ? 1 : 0;
        all.push_back(std::move(c));
    }
    return all;
}

}  // namespace teres::tools
