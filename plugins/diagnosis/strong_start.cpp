#include "plugins/diagnosis/strong_start.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace teres {
namespace {

constexpr std::size_t kFewPlaces = 9, kBestPlaces = 3;
constexpr std::array kSizes{1.0, 3.0};  // of a candidate

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

std::optional<StrongStart> best_strong_start(Simulator& simulator, const Whitener& whitener,
                                             const Eigen::VectorXd& observed, const std::vector<Assumption>& starts) {
    std::optional<StrongStart> best;
    Eigen::VectorXd trajectory;
    for (const Assumption& start : starts) {
        if (!simulator.simulate(start, trajectory)) continue;
        const Eigen::VectorXd difference = observed - trajectory;
        const double misfit = whitener(difference.array().isFinite().select(difference, 0.0)).squaredNorm();
        if (!best || misfit < best->misfit) best = {start, misfit};
    }
    return best;
}

}  // namespace teres
