#include "plugins/diagnosis/innovation_watch.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr double kOvershoot = 1.166;  // Siegmund's correction for discrete time
constexpr double kAlone = 0.6;  // a marker that makes this share of all markers' shift slipped; the body did not move
constexpr double kRigidSpread = 0.35;  // shifts of all markers alike within this share: the camera moved, not the body
constexpr double kSmoothing = 0.25;    // of the level that tells who is shifted, and how, and ...
constexpr double kLevelNoise = kSmoothing / (2.0 - kSmoothing);  // ... the variance of that level of white numbers
constexpr double kDoubt = 2.0;  // standard errors by which the correlation is taken to be larger than it looks
constexpr double kMaxCorrelation = 0.95;
constexpr double kLeastSpread = 1e-3;   // variance of e
constexpr double kMostOfBound = 0.6;    // of the bound, by one frame of all markers together: never one alone, ...
constexpr double kMostStanding = 2.0;   // of the bound: what stood long ends within a second, too
constexpr double kMostPerSecond = 3.0;  // ... nor less than a third of a second

double run_length(double k, double h) {
    const double b = 2.0 * k * (h + kOvershoot);
    return (std::exp(b) - b - 1.0) / (2.0 * k * k);
}

// The mean of `count` squares of N(0,1), as N(0,1) itself (Wilson & Hilferty 1931).
double as_normal(double mean_square, int count) {
    const double variance = 2.0 / (9.0 * count);
    return (std::cbrt(mean_square) - 1.0 + variance) / std::sqrt(variance);
}

}  // namespace

double cusum_bound(double drift, double rate_hz, double false_alarm_period_s, std::size_t channels) {
    const double wanted = 2.0 * static_cast<double>(channels) * rate_hz * false_alarm_period_s;
    double low = 0.0, high = 100.0 / drift;
    for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (low + high);
        (run_length(drift, middle) < wanted ? low : high) = middle;
    }
    return high;
}

InnovationWatch::InnovationWatch(std::size_t markers, const InnovationWatchOptions& options)
    : options_(options), markers_(markers), channels_(3 * markers + 3), level_(3 * markers + 3, 0.0) {
    state_.marker_statistic.assign(markers, 0.0);
    state_.marker_shift.assign(markers, 0.0);
}

void InnovationWatch::restart() noexcept {
    for (Channel& c : channels_) c.up = c.down = 0.0;
    all_.up = standing_.up = 0.0;
    std::fill(state_.marker_shift.begin(), state_.marker_shift.end(), 0.0);
    state_.alarm = false;
    state_.kind = GapKind::kNone;
    state_.onset_us = 0;
    from_the_start_ = false;
    first_us_ = last_us_;
    frames_ = 0;
}

void InnovationWatch::feed(Channel& c, double e, std::int64_t stamp_us, bool learning) noexcept {
    if (!c.started) {
        c.started = true;
        c.previous = c.mean = e;
        c.up_since_us = c.down_since_us = stamp_us;
        return;
    }
    // n numbers underestimate the correlation by (1 + 3 phi) / n (Marriott & Pope 1954), and miss it by
    // sqrt((1 - phi^2) / n): what is left of it in z would make short beginnings alarm.
    const double n = std::max(1.0, static_cast<double>(c.count));
    const double seen = std::clamp(c.variance > 0.0 ? c.covariance / c.variance : 0.0, 0.0, kMaxCorrelation);
    const double phi =
        std::min(seen + (1.0 + 3.0 * seen) / n + kDoubt * std::sqrt((1.0 - seen * seen) / n), kMaxCorrelation);
    const double innovation = (e - c.mean) - phi * (c.previous - c.mean);
    // A recording so far calmer than the filter expects (e of variance 1) promises nothing.
    const double spread = std::sqrt(std::max(c.variance_z, 1.0 - phi * phi));
    const double z = (innovation - c.mean_z) / spread;
    if (!learning) {
        const double clipped = std::clamp(z, -options_.clip, options_.clip);
        c.up = std::max(0.0, c.up + clipped - options_.drift);
        c.down = std::max(0.0, c.down - clipped - options_.drift);
    }
    if (c.up == 0.0) c.up_since_us = stamp_us;
    if (c.down == 0.0) c.down_since_us = stamp_us;
    // Learnt while nothing is under suspicion; running means at first, exponential forgetting later.
    if (!state_.alarm && c.statistic() < 0.5 * (state_.bound > 0.0 ? state_.bound : 1.0)) {
        const double memory = std::max(1.0, options_.forgetting_s / std::max(period_s_, 1e-3));
        const double w = 1.0 / std::min(static_cast<double>(++c.count), memory);
        const double bounded = learning ? e
                                        : c.mean + std::clamp(e - c.mean, -options_.clip * std::sqrt(c.variance),
                                                              options_.clip * std::sqrt(c.variance));
        const double d = bounded - c.mean;
        c.covariance += w * (d * (c.previous - c.mean) - c.covariance);
        c.mean += w * d;
        c.variance += w * (d * d - c.variance);
        const double dz = std::clamp(innovation - c.mean_z, -options_.clip * std::sqrt(c.variance_z),
                                     options_.clip * std::sqrt(c.variance_z));
        c.mean_z += w * dz;
        c.variance_z += w * (dz * dz - c.variance_z);
    }
    c.previous = e;
}

double InnovationWatch::most_of_one_frame() const {
    return std::min(kMostOfBound, kMostPerSecond * period_s_) * state_.bound;
}

void InnovationWatch::feed_standing(double squares, int count, std::int64_t stamp_us) noexcept {
    if (count == 0) return;
    const double step = std::min(as_normal(squares / count, count) - options_.drift_all, most_of_one_frame());
    standing_.up = std::clamp(standing_.up + step, 0.0, kMostStanding * state_.bound);
    if (standing_.up == 0.0) standing_.up_since_us = stamp_us;
}

void InnovationWatch::feed_all(double squares, int count, std::int64_t stamp_us, bool learning) noexcept {
    if (count == 0) return;
    const double w = as_normal(squares / count, count);
    Channel& c = all_;
    const double z = (w - std::max(c.mean, 0.0)) / std::sqrt(std::max(c.variance, 1.0));
    if (!learning) c.up = std::max(0.0, c.up + std::min(z - options_.drift_all, most_of_one_frame()));
    if (c.up == 0.0) c.up_since_us = stamp_us;
    if (state_.alarm || c.up > 0.0) return;
    if (c.count == 0) c.mean = w;
    const double memory = std::max(1.0, options_.forgetting_s / std::max(period_s_, 1e-3));
    const double weight = 1.0 / std::min(static_cast<double>(++c.count) + 1.0, memory);
    const double wild = options_.clip * std::sqrt(c.variance), d = std::clamp(w - c.mean, -wild, wild);
    c.mean += weight * d;
    c.variance += weight * (d * d - c.variance);
}

const GapState& InnovationWatch::update(std::int64_t stamp_us, std::span<const MarkerInnovation> markers) noexcept {
    if (markers.size() != markers_ || (frames_ > 0 && stamp_us <= last_us_)) return state_;
    if (frames_ > 0) {
        const double dt = 1e-6 * static_cast<double>(stamp_us - last_us_);
        period_s_ += (dt - period_s_) / static_cast<double>(std::min<std::int64_t>(frames_, 100));
    } else {
        first_us_ = stamp_us;
    }
    last_us_ = stamp_us;
    ++frames_;
    const bool learning = 1e-6 * static_cast<double>(stamp_us - first_us_) < options_.learning_s;
    if (period_s_ > 0.0)
        state_.bound = cusum_bound(options_.drift, 1.0 / period_s_, options_.false_alarm_period_s,
                                   channels_.size() + 2);  // all_, standing_

    double common[3] = {0.0, 0.0, 0.0}, squares = 0.0, tolerant_squares = 0.0;
    int seen = 0, axes = 0;
    for (std::size_t m = 0; m < markers_; ++m) {
        const MarkerInnovation& marker = markers[m];
        if (!marker.seen || !(marker.sigma_m > 0.0)) continue;
        ++seen;
        for (std::size_t a = 0; a < 3; ++a) {
            const double e = marker.d_m[a] / marker.sigma_m;
            if (!std::isfinite(e)) continue;
            level_[3 * m + a] += kSmoothing * (e - level_[3 * m + a]);
            common[a] += e;
            squares += std::pow(std::min(std::abs(e), options_.clip), 2);
            tolerant_squares += std::pow(std::min(std::abs(e) / options_.tolerance, options_.clip), 2);
            ++axes;
            feed(channels_[3 * m + a], e, stamp_us, learning);
        }
    }
    for (std::size_t a = 0; a < 3 && seen > 0; ++a)
        feed(channels_[3 * markers_ + a], common[a] / std::sqrt(static_cast<double>(seen)), stamp_us, learning);
    feed_all(squares, axes, stamp_us, learning);
    feed_standing(tolerant_squares, axes, stamp_us);
    judge(stamp_us);
    return state_;
}

void InnovationWatch::judge(std::int64_t stamp_us) noexcept {
    const Channel* worst = &channels_.front();
    for (const Channel& c : channels_)
        if (c.statistic() > worst->statistic()) worst = &c;
    if (all_.up > worst->statistic()) worst = &all_;
    if (standing_.up > worst->statistic()) worst = &standing_;
    state_.statistic = worst->statistic();
    for (std::size_t m = 0; m < markers_; ++m) {
        double statistic = 0.0;
        for (std::size_t k = 3 * m; k < 3 * m + 3; ++k) statistic = std::max(statistic, channels_[k].statistic());
        state_.marker_statistic[m] = statistic;
        if (state_.alarm) state_.marker_shift[m] += 0.2 * (std::sqrt(squared_shift(m) / 3.0) - state_.marker_shift[m]);
    }
    if (state_.alarm) {
        const bool stands = from_the_start_ && standing_.up > 0.0;
        if (!stands && 1e-6 * static_cast<double>(stamp_us - alarm_us_) > options_.hold_s) restart();
        return;
    }
    if (state_.bound <= 0.0 || state_.statistic < state_.bound) return;

    state_.alarm = true;
    alarm_us_ = stamp_us;
    state_.onset_us = worst->up > worst->down ? worst->up_since_us : worst->down_since_us;
    from_the_start_ = worst == &standing_;
    state_.kind = kind_of_shift();
}

double InnovationWatch::shift(std::size_t k) const {
    return level_[k] - (from_the_start_ ? 0.0 : channels_[k].mean);
}

double InnovationWatch::spread_squared(std::size_t k) const {
    return from_the_start_ ? options_.tolerance * options_.tolerance : std::max(channels_[k].variance, kLeastSpread);
}

double InnovationWatch::squared_shift(std::size_t marker) const {
    double square = 0.0;
    for (std::size_t k = 3 * marker; k < 3 * marker + 3; ++k) square += shift(k) * shift(k) / spread_squared(k);
    return square;
}

// One marker makes the shift, or all shifted alike: the sensor. Several in different ways: the body.
GapKind InnovationWatch::kind_of_shift() noexcept {
    double mean[3] = {0.0, 0.0, 0.0}, square = 0.0, scatter = 0.0, largest = 0.0, total = 0.0;
    for (std::size_t m = 0; m < markers_; ++m) {
        for (std::size_t a = 0; a < 3; ++a) {
            const double d = shift(3 * m + a);
            mean[a] += d / static_cast<double>(markers_);
            square += d * d / static_cast<double>(markers_);
            scatter += kLevelNoise * spread_squared(3 * m + a) / static_cast<double>(markers_);
        }
        const double beyond_noise = squared_shift(m) - 3.0 * kLevelNoise;
        total += std::max(beyond_noise, 0.0);
        largest = std::max(largest, beyond_noise);
        state_.marker_shift[m] = std::sqrt(squared_shift(m) / 3.0);
    }
    const double common = mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2];
    const bool alike = 2.0 * common > square && square - common < kRigidSpread * kRigidSpread * square + 1.5 * scatter;
    return alike || largest > kAlone * total ? GapKind::kSensor : GapKind::kMechanics;
}

}  // namespace teres
