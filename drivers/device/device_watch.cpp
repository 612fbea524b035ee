#include "drivers/device/device_watch.h"

#include <algorithm>

namespace teres {

const char* state_word(DeviceState state) {
    switch (state) {
        case DeviceState::kAbsent:
            return "absent";
        case DeviceState::kRecovering:
            return "recovering";
        case DeviceState::kStreaming:
            return "streaming";
        case DeviceState::kStale:
            return "stale";
    }
    return "absent";
}

void DeviceWatch::found(std::int64_t now_us) {
    if (state_ != DeviceState::kAbsent) return;
    state_ = DeviceState::kRecovering;
    damaged_ = 0;
    refused_ = false;
    next_us_ = now_us + limits_.retry_after_us;  // cameras may take long to the first frame
}

void DeviceWatch::data(std::int64_t now_us) {
    if (had_data_ && (state_ == DeviceState::kRecovering || state_ == DeviceState::kStale)) ++recoveries_;
    state_ = DeviceState::kStreaming;
    had_data_ = true;
    last_us_ = now_us;
    step_ = damaged_ = 0;
    refused_ = false;
}

void DeviceWatch::damaged(std::int64_t now_us) {
    if (++damaged_ < kMaxDamaged) return;
    damaged_ = 0;
    error(now_us);
}

void DeviceWatch::error(std::int64_t now_us) {
    if (state_ == DeviceState::kAbsent) return;
    refused_ = false;
    const bool recovering = state_ == DeviceState::kRecovering;  // then the steps keep their pace
    next_us_ = recovering ? std::min(next_us_, now_us + limits_.step_after_us) : now_us;
    state_ = DeviceState::kRecovering;
}

void DeviceWatch::refused(std::int64_t now_us) {
    state_ = DeviceState::kRecovering;
    refused_ = true;
    next_us_ = now_us + limits_.step_after_us;
}

void DeviceWatch::gone() {
    state_ = DeviceState::kAbsent;
}

RecoveryStep DeviceWatch::due(std::int64_t now_us) {
    switch (state_) {
        case DeviceState::kStreaming:
            if (now_us - last_us_ >= limits_.stale_after_us) state_ = DeviceState::kStale;
            return RecoveryStep::kNone;
        case DeviceState::kStale:
            if (now_us - last_us_ < limits_.stale_after_us + limits_.step_after_us) return RecoveryStep::kNone;
            state_ = DeviceState::kRecovering;
            return advance(now_us);
        case DeviceState::kRecovering:
            return now_us >= next_us_ ? advance(now_us) : RecoveryStep::kNone;
        case DeviceState::kAbsent:
            break;
    }
    return RecoveryStep::kNone;
}

RecoveryStep DeviceWatch::advance(std::int64_t now_us) {
    if (refused_) {
        next_us_ = now_us + limits_.step_after_us;
        return RecoveryStep::kReopen;
    }
    constexpr RecoveryStep kSteps[] = {RecoveryStep::kRestartStream, RecoveryStep::kReopen, RecoveryStep::kReset,
                                       RecoveryStep::kAdvisePowerCycle};
    const int step = step_++;
    next_us_ = now_us + (step < 3 ? limits_.step_after_us : limits_.retry_after_us);
    if (step < 4) return kSteps[step];
    return step % 2 == 0 ? RecoveryStep::kReopen : RecoveryStep::kReset;
}

}  // namespace teres
