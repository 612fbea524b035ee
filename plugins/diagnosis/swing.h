// Recordings with inertia: how a body swings follows from how stiff it is, how its motion dies out and what mass goes
// with it. Fitted alone each of them makes up for the others, and from where it ends no descent leads back: a body so
// damped that it creeps says nothing of a mass. Fitted together they are found from far off, and what else may stand
// for one of them is tried beside the others as they are then.
#pragma once

#include <memory>
#include <vector>

#include "plugins/diagnosis/cause_fit.h"

namespace teres {

/// Stiffness, damping and added mass, or two of them where the third cannot be, fitted together, from a softer and from
/// a stiffer body with usual damping and mass, the mass where first order sees most of it: to a quarter of the fitted
/// frames, half of them, all. The better of both; null if fewer can be, or no body holds.
std::shared_ptr<const Swing> fit_swing(Problem& problem, const Fit& nominal);

/// Where these explain most of what the nominal model leaves: sets of some of them, and everything else in the place of
/// each effect of the best of all these sets, tried on the beginning and fitted where it comes near. Nothing where they
/// do not. A set is scored as what a search on top of the best set of one effect less would find; the effects of that
/// come first in it.
std::vector<Cause> search_from_swing(Problem& problem, const Fit& nominal);

}  // namespace teres
