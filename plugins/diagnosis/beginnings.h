// Recordings with inertia: what the beginning says of each effect. A phase that runs away is first order at the
// beginning only.
#pragma once

#include "plugins/diagnosis/problem.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// Where first order does not reach (a phase that runs away), each mechanical effect without a place, and those with
/// one that explain something there, are fitted to the beginning (a quarter, then half); its values there are where its
/// refit starts. `screening`: of the beginning. Returns what is worth its numbers there, best first, with
///     score = -(nu/2) ln(left / left without it) - (k/2) ln nu,     k: its numbers [nats]
std::vector<EffectScreening> try_beginnings(Problem& problem, const Fit& base, Screening screening,
                                            const Simulator::Progress& report);

/// With inertia, what the whole recording says of mechanics at first order is void: no more than the beginning shows.
void take_from_beginning(const EffectTable& effects, const std::vector<EffectScreening>& begun, Screening& whole);

/// What is refitted with inertia: mechanics by what it explains of the beginning, a sensor if first order is for it.
std::vector<EffectScreening> choose_with_inertia(const EffectTable& effects, const std::vector<EffectScreening>& begun,
                                                 std::size_t most, const Screening& whole);

}  // namespace teres
