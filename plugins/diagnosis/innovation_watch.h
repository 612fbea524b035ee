// Sequential test of the filter's innovations: tells within a fraction of a second that something began which the
// filter does not explain, and false alarms at most once an hour.
//
//     e   = d / sigma                       innovation of a marker axis (and of the mean over markers: common modes)
//     z_t = (e_t - phi e_{t-1} - m) / s     whitened: structured model error is correlated in time; m, s, phi learnt,
//                                           phi by two standard errors too large;
//                                           s^2 >= 1 - phi^2: no less than the filter expects of e (variance 1)
//     g+  = max(0, g+ + clip(z) - k),  g- = max(0, g- - clip(z) - k)          CUSUM, both directions
//     q   = mean of min(|e|, clip)^2 over all n axes seen: what moves many markers, each its own way, in one jump
//     w   = (q^{1/3} - 1 + 2/(9 n)) / sqrt(2/(9 n))     N(0,1) where e is (Wilson & Hilferty 1931)
//     g   = max(0, g + min((w - m) / s - k_all, share h)),   m >= 0, s >= 1; share: no single frame suffices
//     the same of e / tolerance with m = 0, s = 1: what is there from the start is learnt by all others as the level
//     alarm when a g exceeds h;  onset: the last frame at which that g was zero
//
// Run length between false alarms of one CUSUM of white Gaussian z (Siegmund 1985):
//     ARL = (exp(2 k b) - 2 k b - 1) / (2 k^2),  b = h + 1.166
// h is chosen so that all channels together alarm once in `false_alarm_period_s`.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace teres {

struct InnovationWatchOptions {
    double false_alarm_period_s = 7200.0;  ///< twice the promised hour: z is not exactly Gaussian
    double drift = 1.75;                   ///< k, half the smallest shift looked for, in standard deviations
    double drift_all = 2.5;                ///< k_all: the same of all markers together, only for what is gross
    double tolerance = 2.0;                ///< the filter may be too sure of its innovations by this factor
    double learning_s = 3.0;     ///< level, spread and correlation are learnt; no alarm before but of what is gross
    double forgetting_s = 60.0;  ///< level and spread follow slow changes
    double clip = 2.75;          ///< wild values are no shift: four at least, of one direction
    double hold_s = 5.0;  ///< an alarm stands so long, then the new state is learnt (from the start: while it lasts)
};

/// Innovation of one marker; `used` false: lost or gated (a gated marker counts, a lost one does not).
struct MarkerInnovation {
    double d_m[3];
    double sigma_m;
    bool seen;
};

enum class GapKind { kNone, kSensor, kMechanics };

struct GapState {
    bool alarm = false;
    GapKind kind = GapKind::kNone;
    std::int64_t onset_us = 0;
    double statistic = 0.0, bound = 0.0;
    std::vector<double> marker_statistic;  ///< largest of the marker's axes
    std::vector<double> marker_shift;      ///< in standard deviations since the onset; 0 without alarm
};

/// h for `channels` two-sided CUSUMs at `rate_hz`.
double cusum_bound(double drift, double rate_hz, double false_alarm_period_s, std::size_t channels);

class InnovationWatch {
  public:
    InnovationWatch(std::size_t markers, const InnovationWatchOptions& options);

    /// [loop] One frame; stamps must not go backwards (a frame that does is ignored). markers as given to the
    /// constructor.
    const GapState& update(std::int64_t stamp_us, std::span<const MarkerInnovation> markers) noexcept;
    const GapState& state() const { return state_; }

  private:
    struct Channel {
        double mean = 0.0, variance = 1.0, covariance = 0.0, previous = 0.0;  // of e; learnt
        double mean_z = 0.0, variance_z = 1.0;
        double up = 0.0, down = 0.0;
        std::int64_t up_since_us = 0, down_since_us = 0;
        int count = 0;
        bool started = false;
        double statistic() const { return up > down ? up : down; }
    };
    void feed(Channel& channel, double e, std::int64_t stamp_us, bool learning) noexcept;
    void feed_all(double squares, int count, std::int64_t stamp_us, bool learning) noexcept;
    void feed_standing(double squares, int count, std::int64_t stamp_us) noexcept;
    double most_of_one_frame() const;
    double shift(std::size_t channel) const;  // of the smoothed e, from what is usual
    double spread_squared(std::size_t channel) const;
    double squared_shift(std::size_t marker) const;  // in spreads, of its three axes
    GapKind kind_of_shift() noexcept;                // sets marker_shift
    void judge(std::int64_t stamp_us) noexcept;
    void restart() noexcept;

    InnovationWatchOptions options_;
    std::size_t markers_;
    std::vector<Channel> channels_;  // 3 per marker, then 3 common modes
    Channel all_;                    // w; only upwards
    Channel standing_;               // w of e / tolerance, measured by nothing learnt
    std::vector<double> level_;      // smoothed e per channel
    GapState state_;
    bool from_the_start_ = false;  // the alarm is of standing_: what is usual is what the filter expects
    std::int64_t first_us_ = 0, last_us_ = 0, alarm_us_ = 0;
    std::int64_t frames_ = 0;
    double period_s_ = 0.0;
};

}  // namespace teres
