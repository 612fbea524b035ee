// Starts of a refit away from first order. What begins at a threshold (a dead zone, a gap, a support that yields, a
// band that lets go) changes little by little less than it does as a whole: such an effect is tried at full size.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "plugins/diagnosis/problem.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// Candidates of one effect at its places (all if few, else the best), at one and at several times their size, with the
/// sign of first order; of an event the candidates of one instant, whose places and extents first order does not tell
/// apart, at the most that is possible if several times their size is more. Nominal parameters as given. Sensor effects
/// are linear: none.
std::vector<Assumption> strong_starts(const EffectTable& effects, const EffectScreening& screened,
                                      const std::vector<double>& theta);

/// Frames by which starts are compared: at most ten, spread over those before `end`.
std::vector<std::int32_t> trial_frames(std::size_t end);

/// |W (y - h)|^2 of these frames alone; h: `trajectory`, full.
double left_at(const Problem& problem, std::span<const std::int32_t> frames, const Eigen::VectorXd& trajectory);

/// Of these frames the one at which `trajectory` (full) leaves most.
std::int32_t furthest_off(const Problem& problem, std::span<const std::int32_t> frames,
                          const Eigen::VectorXd& trajectory);

/// Those whose simulations leave the least at `frames`, best first; none if no body holds under any of them. One of a
/// lasting effect; of an event, which does not stand out before the ligaments are fitted, the best few, each at the
/// instant that leaves the least.
struct StrongStart {
    Assumption at;
    double left = 0.0;
};
std::vector<StrongStart> best_strong_starts(Problem& problem, std::span<const std::int32_t> frames,
                                            const std::vector<Assumption>& starts);
/// Those of a screened effect from the median of the prior, at trial_frames() of what is fitted.
std::vector<StrongStart> best_strong_starts(Problem& problem, const EffectScreening& screened);

/// `to` at the instant of `from`, another of the same effect, if that has one.
ActiveEffect with_instant_of(const EffectEntry& entry, ActiveEffect to, const ActiveEffect& from);

/// What was fitted (`trajectory`: how it moves, full) with its last effect, an event, about the instant between two
/// frames that leaves the least of all. Nothing if that effect has no instant, with inertia or with a sensor effect.
std::optional<StrongStart> at_best_instant(Problem& problem, const Assumption& fitted,
                                           const Eigen::VectorXd& trajectory);

}  // namespace teres
