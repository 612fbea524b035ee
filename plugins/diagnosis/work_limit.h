// When a search has to end: an answer late is worth less than one that is marked as cut short.
#pragma once

#include <atomic>
#include <ctime>

namespace teres {

/// Processor time of this process, of all its threads: what else runs on the machine changes the clock, not the answer.
class WorkLimit {
  public:
    /// From now on; 0: none [s].
    explicit WorkLimit(double limit_s) : limit_s_(limit_s), start_(std::clock()) {}

    /// Asked before work that an answer can do without. Any thread.
    bool reached() const noexcept {
        const bool out = limit_s_ > 0.0 && used_s() > limit_s_;
        if (out) cut_short_.store(true, std::memory_order_relaxed);
        return out;
    }
    /// Whether no more than half of it is used.
    bool leaves_as_much() const noexcept { return limit_s_ <= 0.0 || used_s() <= 0.5 * limit_s_; }
    /// Whether something was left out.
    bool cut_short() const noexcept { return cut_short_.load(std::memory_order_relaxed); }
    double limit_s() const noexcept { return limit_s_; }

  private:
    double used_s() const noexcept { return static_cast<double>(std::clock() - start_) / CLOCKS_PER_SEC; }

    double limit_s_;
    std::clock_t start_;
    mutable std::atomic<bool> cut_short_{false};
};

}  // namespace teres
