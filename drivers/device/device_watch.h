// Is a device alive, and what is to be done about it if not? The state machine of every device; it makes no calls.
//
//     absent ──found──▶ recovering ──data──▶ streaming ──silent for stale_after──▶ stale
//       ▲                   ▲  ▲                                                    │
//       └──gone (any state) │  └──────────────── still silent for step_after ───────┘
//                           └── error while streaming
//
//     recovering, one step after another, step_after apart, until data comes again:
//     restart the stream, re-open the node, reset the device, advise a power cycle; then re-open and reset in turn,
//     retry_after apart. Who refused to be opened is only opened again.
#pragma once

#include <cstdint>

namespace teres {

enum class DeviceState { kAbsent, kRecovering, kStreaming, kStale };
const char* state_word(DeviceState state);

enum class RecoveryStep { kNone, kRestartStream, kReopen, kReset, kAdvisePowerCycle };

class DeviceWatch {
  public:
    struct Limits {
        std::int64_t stale_after_us = 250'000;
        std::int64_t step_after_us = 1'000'000;
        std::int64_t retry_after_us = 3'000'000;
    };
    explicit DeviceWatch(const Limits& limits) : limits_(limits) {}

    void found(std::int64_t now_us);    ///< the device is there again; data may follow
    void data(std::int64_t now_us);     ///< a good frame or report
    void damaged(std::int64_t now_us);  ///< a bad one; kMaxDamaged in a row count as an error
    void error(std::int64_t now_us);    ///< a call failed: the next step is due at once
    void refused(std::int64_t now_us);  ///< in use elsewhere, not permitted, wrong format: only re-opening makes sense
    void gone();                        ///< unplugged, or reset
    /// What is due now; each step is told once.
    RecoveryStep due(std::int64_t now_us);

    DeviceState state() const { return state_; }
    std::int64_t recoveries() const { return recoveries_; }  ///< times data came back after a loss
    static constexpr int kMaxDamaged = 5;

  private:
    RecoveryStep advance(std::int64_t now_us);

    Limits limits_;
    DeviceState state_ = DeviceState::kAbsent;
    std::int64_t last_us_ = 0;  // newest data, or when the device was found
    std::int64_t next_us_ = 0;  // when the next step is due while recovering
    int step_ = 0;              // steps taken since the last data
    int damaged_ = 0;
    bool refused_ = false;
    bool had_data_ = false;
    std::int64_t recoveries_ = 0;
};

}  // namespace teres
