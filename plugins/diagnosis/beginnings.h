// Recordings with inertia: what the beginning says of each effect. A phase that runs away is first order at the
// beginning only.
#pragma once

#include <optional>
#include <vector>

#include "plugins/diagnosis/problem.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// A fit to one part in `share` of the fitted frames.
Fit fit_beginning(Problem& problem, std::size_t share, const Assumption& start, int iterations);

/// What a fit of what is known to half of the beginning leaves.
double left_of_beginning(Problem& problem, const Assumption& known);

/// Where first order does not reach (a phase that runs away), each mechanical effect without a place, and those with
/// one that explain something there, are fitted to the beginning (a quarter, then half); its values there are where its
/// refit starts, and those of what is known are its `beside`. `screening`: of the beginning. Returns what is worth its
/// numbers there, best first, with
///     score = -(nu/2) ln(left / before) - (k/2) ln nu,     k: its numbers [nats], before: left_of_beginning()
///
/// What leaves more than `most_of_quarter` there is not tried on half.
std::vector<EffectScreening> try_beginnings(Problem& problem, const Assumption& known, double before,
                                            Screening screening, double most_of_quarter,
                                            const Simulator::Progress& report);

/// What is known took up what it could of what is missing, and may hide it: a body so damped that it hardly swings says
/// nothing of a mass. The same with usual amplitudes where they are far from that; nothing if none is.
std::optional<Assumption> at_usual_size(const Simulator& simulator, const Assumption& known);

/// Each effect as it was tried first, or `anew` where that is clearly better or the first was worth nothing; best
/// first.
std::vector<EffectScreening> better_of(std::vector<EffectScreening> begun, const std::vector<EffectScreening>& anew);

/// With inertia, what the whole recording says of mechanics at first order is void: no more than the beginning shows.
void take_from_beginning(const EffectTable& effects, const std::vector<EffectScreening>& begun, Screening& whole);

/// What is refitted with inertia: mechanics by what it explains of the beginning, a sensor if first order is for it.
std::vector<EffectScreening> choose_with_inertia(const EffectTable& effects, const std::vector<EffectScreening>& begun,
                                                 std::size_t most, const Screening& whole);

}  // namespace teres
