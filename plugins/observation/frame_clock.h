// Capture clock against reception clock, from the stamps alone.
//
//     reception - capture = offset + drift (capture - t₀) + delay,    delay >= 0
//
// drift by least squares with exponential forgetting; offset is the smallest difference left, so that latency counts
// from the fastest frame (the constant part of the transport cannot be told from a clock offset).
#pragma once

#include <cstdint>

namespace teres {

class FrameClock {
  public:
    /// [loop] One frame.
    void add(std::int64_t capture_us, std::int64_t reception_us);

    std::int64_t frames() const { return frames_; }
    double offset_s() const { return offset_s_; }
    double drift_ppm() const { return 1e6 * drift_; }
    double latency_s() const { return latency_s_; }  ///< of the newest frame, above the fastest

  private:
    std::int64_t frames_ = 0, first_capture_us_ = 0, last_capture_us_ = 0, first_difference_us_ = 0;
    double weight_ = 0.0, mean_t_ = 0.0, mean_d_ = 0.0, var_t_ = 0.0, cov_ = 0.0;
    double drift_ = 0.0, offset_s_ = 0.0, latency_s_ = 0.0;
};

}  // namespace teres
