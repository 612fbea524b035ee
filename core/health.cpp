#include "core/health.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>

#include "core/message_stamp.h"

namespace teres {

TrafficBook::Traffic* TrafficBook::entry(std::string_view channel) noexcept {
    const auto found = channels_.find(channel);
    if (found != channels_.end()) return &found->second;
    try {
        const bool full = channels_.size() >= kMaxChannels;
        return &channels_[full ? "(other)" : std::string(channel)];
    } catch (...) {
        return nullptr;
    }
}

void TrafficBook::count(Traffic& traffic, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept {
    ++traffic.received;
    traffic.last_us = now_us;
    if (const auto stamp = stamp_of(data)) {
        const std::int64_t last = traffic.last_sequence;
        // A forged sequence must not spoil the count for good: a gap above a million is a new publisher.
        if (last >= 0 && stamp->sequence > last && stamp->sequence - last <= 1'000'000)
            traffic.dropped += stamp->sequence - last - 1;
        traffic.last_sequence = stamp->sequence;
    }
}

void TrafficBook::received(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept {
    Traffic* traffic = entry(channel);
    if (traffic == nullptr) return;
    if (!traffic->heard) {  // what was counted on the way out comes in now
        *traffic = Traffic{};
        traffic->heard = true;
    }
    count(*traffic, data, now_us);
}

void TrafficBook::sent(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) noexcept {
    Traffic* traffic = entry(channel);
    if (traffic != nullptr && !traffic->heard) count(*traffic, data, now_us);
}

void TrafficBook::refused(std::string_view channel) noexcept {
    if (Traffic* traffic = entry(channel)) ++traffic->dropped;
}

void TrafficBook::report(std::vector<channel_health_t>& to, std::int64_t now_us) {
    const double period_s = reported_us_ < 0 ? 0.0 : 1e-6 * static_cast<double>(now_us - reported_us_);
    to.resize(channels_.size());
    std::size_t at = 0;
    for (auto& [name, traffic] : channels_) {
        channel_health_t& out = to[at++];
        out.channel = name;
        out.rate_hz = period_s > 0.0 ? static_cast<double>(traffic.received - traffic.received_before) / period_s : 0.0;
        out.age_s = traffic.last_us < 0 ? -1.0 : 1e-6 * static_cast<double>(now_us - traffic.last_us);
        out.received = traffic.received;
        out.dropped = traffic.dropped;
        traffic.received_before = traffic.received;
    }
    reported_us_ = now_us;
}

MemoryReader::MemoryReader() : statm_(open("/proc/self/statm", O_RDONLY | O_CLOEXEC)) {}

MemoryReader::~MemoryReader() {
    if (statm_ >= 0) close(statm_);
}

double MemoryReader::resident_mb() const noexcept {
    char text[128] = {};
    if (statm_ < 0 || pread(statm_, text, sizeof(text) - 1, 0) <= 0) return -1.0;
    char* second = nullptr;
    std::strtoll(text, &second, 10);  // total size, resident pages, ...
    const auto pages = static_cast<double>(std::strtoll(second, nullptr, 10));
    return pages * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1024.0 * 1024.0);
}

double MemoryReader::peak_mb() const noexcept {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<double>(usage.ru_maxrss) / 1024.0;  // ru_maxrss is in KiB
}

const char* state_word(const HostedUnit& unit, std::int64_t now_us, std::int64_t stale_after_us) noexcept {
    switch (unit.state()) {
        case UnitState::kCreated:
        case UnitState::kConfigured:
            return "waiting";
        case UnitState::kStopped:
            return "stopped";
        case UnitState::kFailed:
            return "failed";
        case UnitState::kFinished:
            return "finished";
        case UnitState::kRunning:
            break;
    }
    const StepTimes& times = unit.times();
    if (unit.is_driver()) {
        if (times.last_work_us == 0) return "absent";
        if (now_us - times.last_work_us > stale_after_us) return "stale";
        return times.degraded ? "degraded" : "streaming";
    }
    return times.degraded ? "degraded" : "running";
}

}  // namespace teres
