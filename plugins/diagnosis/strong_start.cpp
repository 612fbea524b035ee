#include "plugins/diagnosis/strong_start.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace teres {
namespace {

constexpr std::size_t kFewPlaces = 9, kBestPlaces = 3;
constexpr std::array kSizes{1.0, 3.0};  // of a candidate
constexpr std::size_t kTrialFrames = 10;
constexpr std::size_t kBestOfEvent = 5;  // of a tear: along a front that is sharp, descents end in hollows
constexpr std::size_t kFewFrames = 3, kTriedFully = 4;  // starts that look best at a few frames go on to all of them

// The candidate's amplitudes times `size`, each to the side of null on which `start` lies.
ActiveEffect grown(const EffectEntry& entry, const ActiveEffect& candidate, const ActiveEffect& start, double size) {
    ActiveEffect out = candidate;
    for (std::size_t p = 0; p < out.values.size(); ++p) {
        const EffectParameter& parameter = entry.parameters[p];
        const double null = parameter.null_value, full = candidate.values[p];
        if (parameter.role != EffectRole::kAmplitude || full == null) continue;
        const double signed_size = (start.values[p] - null) * (full - null) < 0.0 ? -size : size;
        out.values[p] = std::clamp(at_share(parameter, full, signed_size), parameter.lower, parameter.upper);
    }
    return out;
}

// Whether an amplitude is at a bound: no larger size is to be tried, and one as large says more than a smaller one.
bool at_bound(const EffectEntry& entry, const ActiveEffect& effect) {
    for (std::size_t p = 0; p < effect.values.size(); ++p) {
        const EffectParameter& parameter = entry.parameters[p];
        const double value = effect.values[p];
        if (parameter.role == EffectRole::kAmplitude && (value <= parameter.lower || value >= parameter.upper))
            return true;
    }
    return false;
}

// The last of each of `count` equal parts of what is before `end`.
std::vector<std::int32_t> evenly(std::size_t count, std::size_t end) {
    std::vector<std::int32_t> out;
    for (std::size_t k = 1; k <= count; ++k) out.push_back(static_cast<std::int32_t>(k * end / count - 1));
    return out;
}

// Which parameters of an effect say when it begins and how long that takes; nothing if it lasts.
struct Instant {
    std::size_t onset, duration;
};
std::optional<Instant> instant_of(const EffectEntry& entry) {
    const auto onset = parameter_of(entry, "onset"), duration = parameter_of(entry, "duration");
    if (!entry.info.event || !onset || !duration) return std::nullopt;
    return Instant{*onset, *duration};
}

// Without inertia a body at an event is at each frame what it is before or after it: simulated once before and once
// after, it is known for every instant.
class AroundEvent {
  public:
    /// `starts`: alike but for the parameters of their last effect. Makes nothing of those without an instant.
    AroundEvent(Problem& problem, const std::vector<Assumption>& starts) : problem_(problem) {
        if (starts.empty()) return;
        const EffectTable& effects = problem.simulator.effects();
        without_ = starts.front();
        const EffectEntry& entry = effects[without_.effects.back().entry];
        const bool seen_as_it_moves = std::none_of(without_.effects.begin(), without_.effects.end(),
                                                   [&](const auto& active) { return effects[active.entry].sensor; });
        without_.effects.pop_back();
        if (!problem.simulator.mechanics().dynamic() && seen_as_it_moves) at_ = instant_of(entry);
        if (!at_) return;
        earliest_s_ = entry.parameters[at_->onset].lower;
        shortest_s_ = entry.parameters[at_->duration].lower;
    }
    /// The body before it; to be called, for all frames that are asked for later, before best_instant() and from one
    /// thread.
    bool simulate_before(std::span<const std::int32_t> frames) {
        return !at_ || problem_.simulator.simulate_at(without_, frames, before_);
    }
    /// The body after it at `frames`, and before it as simulate_before() does: where `fitted`, whose trajectory is
    /// given, is at one of the two, only the other is simulated.
    std::optional<Eigen::VectorXd> simulate_others(const Assumption& fitted, const Eigen::VectorXd& trajectory,
                                                   const std::vector<std::int32_t>& frames) {
        const ActiveEffect& event = fitted.effects.back();
        const double onset_s = event.values[at_->onset], end_s = onset_s + event.values[at_->duration];
        const std::vector<double>& times_s = problem_.simulator.times_s();
        const auto first_from = [&](double time_s) {
            return std::partition_point(frames.begin(), frames.end(),
                                        [&](std::int32_t f) { return times_s[static_cast<std::size_t>(f)] < time_s; });
        };
        const std::span<const std::int32_t> later(first_from(onset_s), frames.end()),
            earlier(frames.begin(), first_from(end_s));
        Eigen::VectorXd after, simulated;
        const auto simulate = [&](const Assumption& at, std::span<const std::int32_t> missing, Eigen::VectorXd& out) {
            out = trajectory;
            if (missing.empty()) return true;
            if (!problem_.simulator.simulate_at(at, missing, simulated)) return false;
            const auto channels = static_cast<Eigen::Index>(3 * problem_.recording.num_markers);
            for (const std::int32_t f : missing)
                out.segment(channels * f, channels) = simulated.segment(channels * f, channels);
            return true;
        };
        if (!simulate(without_, later, before_) || !simulate(this->after(fitted), earlier, after)) return {};
        return after;
    }
    /// Of `frames` those to be simulated with it: it does not happen before the first.
    std::span<const std::int32_t> after_some(std::span<const std::int32_t> frames) const {
        return at_ ? frames.subspan(1) : frames;
    }
    /// The first of `frames` and the one at which the body before it is furthest off.
    std::vector<std::int32_t> furthest_off(const Problem& problem, std::span<const std::int32_t> frames) const {
        return {frames.front(), teres::furthest_off(problem, frames.subspan(1), before_)};
    }
    /// `start` as it is to be simulated: what has an instant, from the beginning.
    Assumption after(Assumption start) const {
        if (at_) set(start, earliest_s_, shortest_s_);
        return start;
    }
    struct Best {
        double left = 0.0;
        std::size_t first_after = 0;  ///< in `frames`
    };
    /// The least that is left if it happens just before one of the frames but the first; `simulated`: after().
    Best best_instant(const Problem& problem, std::span<const std::int32_t> frames,
                      const Eigen::VectorXd& simulated) const {
        if (!at_) return {left_at(problem, frames, simulated), 0};
        const auto channels = static_cast<Eigen::Index>(3 * problem.recording.num_markers);
        Best best{std::numeric_limits<double>::infinity(), 1};
        Eigen::VectorXd mixed = simulated;
        for (std::size_t k = 1; k < frames.size(); ++k) {
            const Eigen::Index last_before = channels * frames[k - 1];
            mixed.segment(last_before, channels) = before_.segment(last_before, channels);
            const double left = left_at(problem, frames, mixed);
            if (left < best.left) best = {left, k};
        }
        return best;
    }
    /// `start` with the middle of its event half way between these frames; it takes as long as it does in `start`, or
    /// from the one to the other: fits shorten or stretch it, but only where a frame is amid it.
    Assumption between(Assumption start, std::int32_t frame, std::int32_t next) const {
        if (!at_) return start;
        const auto time_s = [&](std::int32_t f) { return problem_.simulator.times_s()[static_cast<std::size_t>(f)]; };
        const double duration_s = std::max(start.effects.back().values[at_->duration], time_s(next) - time_s(frame));
        set(start, std::max(earliest_s_, 0.5 * (time_s(frame) + time_s(next) - duration_s)), duration_s);
        return start;
    }
    bool has_instant() const { return at_.has_value(); }

  private:
    void set(Assumption& start, double onset_s, double duration_s) const {
        start.effects.back().values[at_->onset] = onset_s;
        start.effects.back().values[at_->duration] = duration_s;
    }
    Problem& problem_;
    std::optional<Instant> at_;
    double earliest_s_ = 0.0, shortest_s_ = 0.0;  // lower bounds
    Assumption without_;
    Eigen::VectorXd before_;
};

}  // namespace

std::vector<Assumption> strong_starts(const EffectTable& effects, const EffectScreening& screened,
                                      const std::vector<double>& theta) {
    std::vector<Assumption> starts;
    const EffectEntry& entry = effects[screened.entry];
    if (entry.sensor) return starts;
    const auto add = [&](std::size_t candidate, const ActiveEffect& start) {
        for (const double size : kSizes)
            starts.push_back({theta, {grown(entry, effects.candidate(screened.entry, candidate), start, size)}});
    };
    if (screened.places.empty()) {
        add(screened.candidate, screened.start);
        return starts;
    }
    if (const auto at = instant_of(entry)) {  // how far it reaches is not seen by first order
        const double onset = effects.candidate(screened.entry, 0).values[at->onset];
        for (std::size_t c = 0; c < static_cast<std::size_t>(entry.info.num_candidates); ++c) {
            const ActiveEffect full = effects.candidate(screened.entry, c);
            if (full.values[at->onset] != onset) continue;
            const ActiveEffect most = grown(entry, full, full, kSizes.back());
            if (at_bound(entry, most))
                starts.push_back({theta, {most}});
            else
                add(c, full);
        }
        return starts;
    }
    const auto places =
        screened.places.size() <= kFewPlaces ? screened.places : best_places(screened.places, kBestPlaces);
    for (const PlaceGain& place : places) add(place.candidate, place.start);
    return starts;
}

std::vector<std::int32_t> trial_frames(std::size_t end) {
    return evenly(std::min(kTrialFrames, end), end);
}

double left_at(const Problem& problem, std::span<const std::int32_t> frames, const Eigen::VectorXd& trajectory) {
    const Eigen::Index channels = trajectory.size() / static_cast<Eigen::Index>(problem.recording.num_frames);
    Eigen::VectorXd difference = Eigen::VectorXd::Zero(trajectory.size());
    for (const std::int32_t f : frames)
        difference.segment(channels * f, channels) =
            problem.recording.observed.segment(channels * f, channels) - trajectory.segment(channels * f, channels);
    return problem.whitener(difference.array().isFinite().select(difference, 0.0)).squaredNorm();
}

std::int32_t furthest_off(const Problem& problem, std::span<const std::int32_t> frames,
                          const Eigen::VectorXd& trajectory) {
    const auto left = [&](std::int32_t f) { return left_at(problem, {&f, 1}, trajectory); };
    return *std::max_element(frames.begin(), frames.end(),
                             [&](std::int32_t a, std::int32_t b) { return left(a) < left(b); });
}

std::vector<StrongStart> best_strong_starts(Problem& problem, std::span<const std::int32_t> frames,
                                            const std::vector<Assumption>& starts) {
    AroundEvent event(problem, starts);
    std::vector<AroundEvent::Best> found(starts.size());
    const auto try_at = [&](std::span<const std::int32_t> which, const std::vector<std::size_t>& tried) {
        found.assign(starts.size(), {std::numeric_limits<double>::infinity(), 0});
        side_by_side(problem, tried.size(), [&](Problem& p, std::size_t k) {
            Eigen::VectorXd trajectory;
            const std::size_t start = tried[k];
            if (p.simulator.simulate_at(event.after(starts[start]), event.after_some(which), trajectory))
                found[start] = event.best_instant(p, which, trajectory);
        });
    };
    std::vector<std::size_t> order(starts.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto keep_best = [&](std::size_t count) {
        std::stable_sort(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return found[a].left < found[b].left; });
        order.resize(std::min(order.size(), count));
    };
    const std::size_t wanted = event.has_instant() ? kBestOfEvent : 1, fully = std::max(kTriedFully, 2 * wanted);
    // Frame by frame a body follows in small steps: many of them cost an event hardly more than a few far apart.
    std::vector<std::int32_t> all(static_cast<std::size_t>(frames.back()) + 1);
    std::iota(all.begin(), all.end(), 0);
    if (event.has_instant()) {
        if (!event.simulate_before(all)) return {};
        if (starts.size() > fully && frames.size() > 1) {
            try_at(event.furthest_off(problem, frames), order);
            keep_best(fully);
        }
    } else if (starts.size() > fully && frames.size() > kFewFrames) {
        std::vector<std::int32_t> few = evenly(kFewFrames, frames.size());
        for (std::int32_t& f : few) f = frames[static_cast<std::size_t>(f)];
        try_at(few, order);
        keep_best(fully);
    }
    try_at(event.has_instant() ? all : frames, order);
    keep_best(wanted);
    std::erase_if(order, [&](std::size_t k) { return !std::isfinite(found[k].left); });
    std::vector<StrongStart> best;
    best.reserve(order.size());
    for (const std::size_t k : order) best.push_back({starts[k], found[k].left});
    for (std::size_t k = 0; k < order.size(); ++k)
        if (const auto next = static_cast<std::int32_t>(found[order[k]].first_after); next > 0)
            best[k].at = event.between(best[k].at, next - 1, next);
    return best;
}

std::vector<StrongStart> best_strong_starts(Problem& problem, const EffectScreening& screened) {
    const std::vector<double> theta = prior_median(problem.simulator.mechanics()).theta;
    return best_strong_starts(problem, trial_frames(problem.recording.first_held_frame),
                              strong_starts(problem.simulator.effects(), screened, theta));
}

ActiveEffect with_instant_of(const EffectEntry& entry, ActiveEffect to, const ActiveEffect& from) {
    if (const auto at = instant_of(entry))
        for (const std::size_t p : {at->onset, at->duration}) to.values[p] = from.values[p];
    return to;
}

std::optional<StrongStart> at_best_instant(Problem& problem, const Assumption& fitted,
                                           const Eigen::VectorXd& trajectory) {
    AroundEvent event(problem, {fitted});
    if (!event.has_instant()) return {};
    std::vector<std::int32_t> all(problem.recording.first_held_frame);
    if (all.size() < 2) return {};
    std::iota(all.begin(), all.end(), 0);
    const auto after = event.simulate_others(fitted, trajectory, all);
    if (!after) return {};
    const AroundEvent::Best best = event.best_instant(problem, all, *after);
    const auto next = static_cast<std::int32_t>(best.first_after);
    return StrongStart{event.between(fitted, next - 1, next), best.left};
}

}  // namespace teres
