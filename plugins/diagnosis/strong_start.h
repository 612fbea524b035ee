// Starts of a refit away from first order. What begins at a threshold (a dead zone, a gap, a support that yields, a
// band that lets go) changes little by little less than it does as a whole: such an effect is tried at full size.
#pragma once

#include <optional>

#include "plugins/diagnosis/problem.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// Candidates of one effect at its places (all if few, else the best), at one and at several times their size, with the
/// sign of first order; nominal parameters as given. Sensor effects are linear: none.
std::vector<Assumption> strong_starts(const EffectTable& effects, const EffectScreening& screened,
                                      const std::vector<double>& theta);

/// Frames by which starts are compared: at most ten, spread over those before `end`.
std::vector<std::int32_t> trial_frames(std::size_t end);

/// |W (y - h)|^2 of these frames alone; h: `trajectory`, full.
double left_at(const Problem& problem, std::span<const std::int32_t> frames, const Eigen::VectorXd& trajectory);

/// The one whose simulation leaves the least at `frames`; nothing if no body holds under any of them.
struct StrongStart {
    Assumption at;
    double left = 0.0;
};
std::optional<StrongStart> best_strong_start(Problem& problem, std::span<const std::int32_t> frames,
                                             const std::vector<Assumption>& starts);

}  // namespace teres
