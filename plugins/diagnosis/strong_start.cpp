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

// The last of each of `count` equal parts of what is before `end`.
std::vector<std::int32_t> evenly(std::size_t count, std::size_t end) {
    std::vector<std::int32_t> out;
    for (std::size_t k = 1; k <= count; ++k) out.push_back(static_cast<std::int32_t>(k * end / count - 1));
    return out;
}

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

std::optional<StrongStart> best_strong_start(Problem& problem, std::span<const std::int32_t> frames,
                                             const std::vector<Assumption>& starts) {
    std::vector<double> left(starts.size());
    const auto try_at = [&](std::span<const std::int32_t> which, const std::vector<std::size_t>& tried) {
        left.assign(starts.size(), std::numeric_limits<double>::infinity());
        side_by_side(problem, tried.size(), [&](Problem& p, std::size_t k) {
            Eigen::VectorXd trajectory;
            const std::size_t start = tried[k];
            if (p.simulator.simulate_at(starts[start], which, trajectory)) left[start] = left_at(p, which, trajectory);
        });
    };
    std::vector<std::size_t> tried(starts.size());
    std::iota(tried.begin(), tried.end(), std::size_t{0});
    if (starts.size() > kTriedFully && frames.size() > kFewFrames) {
        std::vector<std::int32_t> few = evenly(kFewFrames, frames.size());
        for (std::int32_t& f : few) f = frames[static_cast<std::size_t>(f)];
        try_at(few, tried);
        std::stable_sort(tried.begin(), tried.end(), [&](std::size_t a, std::size_t b) { return left[a] < left[b]; });
        tried.resize(kTriedFully);
    }
    try_at(frames, tried);
    const auto best = std::min_element(left.begin(), left.end());
    if (best == left.end() || !std::isfinite(*best)) return {};
    return StrongStart{starts[static_cast<std::size_t>(best - left.begin())], *best};
}

}  // namespace teres
