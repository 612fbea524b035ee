// Several causes at once: one more effect on top of those that are known.
#pragma once

#include <optional>

#include "plugins/diagnosis/cause_fit.h"

namespace teres {

/// Searches one effect more on top of the best of `causes` and adds what it finds. A first effect that was a compromise
/// between two is exchanged: what was added to it is fitted alone, and searched on top of; and of a second one that
/// happens later nothing is to be seen at the beginning, so that what explains that is searched on top of. What was
/// added is given to rivals as well: to single causes hardly behind the first; with inertia, to all sets of as many
/// effects that are not far behind. False: nothing was found that is better than the best before.
bool search_further(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes);

/// Of a set to which an effect was added of which hardly anything is there: the one before, fitted from there. What the
/// set seems to gain is a better fit of that. Nothing for other sets.
std::optional<Cause> without_trace(Problem& problem, const Fit& nominal, const Cause& known, const Cause& larger);

/// What looser forms of the best set would explain besides (Cause::misfit_beside_forms), if nothing was searched on top
/// of it and it leaves more than noise and model error explain. Of recordings without inertia.
void weigh_forms(Problem& problem, const Fit& nominal, std::vector<Cause>& causes);

}  // namespace teres
