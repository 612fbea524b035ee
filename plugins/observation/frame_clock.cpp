#include "plugins/observation/frame_clock.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr double kForget_s = 120.0;
constexpr double kMinSpan_s = 2.0;            // shorter: no drift is told
constexpr double kOffsetRise_s_per_s = 1e-4;  // the floor may rise this fast: a clock step is forgotten in time

}  // namespace

void FrameClock::add(std::int64_t capture_us, std::int64_t reception_us) {
    if (frames_++ == 0) {
        first_capture_us_ = last_capture_us_ = capture_us;
        first_difference_us_ = reception_us - capture_us;
    }
    const double t = 1e-6 * static_cast<double>(capture_us - first_capture_us_);
    const double step_s = std::max(0.0, 1e-6 * static_cast<double>(capture_us - last_capture_us_));
    last_capture_us_ = capture_us;
    // Differences are small numbers beside the clocks themselves: taken from the first one.
    const double d = 1e-6 * static_cast<double>(reception_us - capture_us - first_difference_us_);

    const double keep = std::exp(-step_s / kForget_s);
    weight_ = keep * weight_ + 1.0;
    const double dt = t - mean_t_, dd = d - mean_d_;
    mean_t_ += dt / weight_;
    mean_d_ += dd / weight_;
    var_t_ = keep * var_t_ + dt * (t - mean_t_);
    cov_ = keep * cov_ + dt * (d - mean_d_);
    if (t > kMinSpan_s && var_t_ > 0.0) drift_ = cov_ / var_t_;

    const double floor = 1e-6 * static_cast<double>(first_difference_us_);
    const double level = floor + d;
    offset_s_ = frames_ == 1 ? level : std::min(level, offset_s_ + (drift_ + kOffsetRise_s_per_s) * step_s);
    latency_s_ = level - offset_s_;
}

}  // namespace teres
