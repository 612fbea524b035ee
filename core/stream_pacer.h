// When the next sample of a recording is due: real time, slower, faster, or at once.
//
//     due(k) = due(k-1) + max(0, stamp(k) - stamp(k-1)) / speed        stamps that run backwards are due at
//     once
#pragma once

#include <cstdint>
#include <optional>

namespace teres {

class StreamPacer {
  public:
    /// speed > 0: factor on real time; 0: as fast as possible.
    explicit StreamPacer(double speed) : speed_(speed) {}

    /// [loop] Monotonic time [us] at which the sample stamped `stamp_us` is due; call once per sample, in
    /// order.
    double due_us(std::int64_t stamp_us, std::int64_t now_us) {
        // Differences in double: stamps come from a file and may be anything.
        const double step = last_stamp_us_ ? static_cast<double>(stamp_us) - static_cast<double>(*last_stamp_us_) : 0.0;
        if (!last_stamp_us_) due_us_ = static_cast<double>(now_us);
        if (step < 0.0) ++backward_steps_;
        if (step > 0.0 && speed_ > 0.0) due_us_ += step / speed_;
        last_stamp_us_ = stamp_us;
        return speed_ > 0.0 ? due_us_ : static_cast<double>(now_us);
    }
    std::int64_t backward_steps() const { return backward_steps_; }

  private:
    double speed_;
    double due_us_ = 0.0;
    std::optional<std::int64_t> last_stamp_us_;
    std::int64_t backward_steps_ = 0;
};

}  // namespace teres
