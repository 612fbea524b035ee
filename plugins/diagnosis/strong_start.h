// Starts of a refit away from first order. What begins at a threshold (a dead zone, a gap, a support that yields, a
// band that lets go) changes little by little less than it does as a whole: such an effect is tried at full size.
#pragma once

#include <optional>

#include "plugins/diagnosis/screening.h"
#include "plugins/diagnosis/whitener.h"

namespace teres {

/// Candidates of one effect at its places (all if few, else the best), at one and at several times their size, with the
/// sign of first order; nominal parameters as given. Sensor effects are linear: none.
std::vector<Assumption> strong_starts(const EffectTable& effects, const EffectScreening& screened,
                                      const std::vector<double>& theta);

/// The one whose simulation leaves the least; nothing if no body holds under any of them.
struct StrongStart {
    Assumption at;
    double misfit = 0.0;
};
std::optional<StrongStart> best_strong_start(Simulator& simulator, const Whitener& whitener,
                                             const Eigen::VectorXd& observed, const std::vector<Assumption>& starts);

}  // namespace teres
