// The search for one effect, or for one more: screened by first order, the best refitted with everything free.
#pragma once

#include <vector>

#include "plugins/diagnosis/problem.h"

namespace teres {

/// Screens all effects and refits the best; best score first. Effects that were only screened keep their linear score.
/// The simulator's base is the nominal fit.
std::vector<Cause> search(Problem& problem, const Fit& nominal, Screening& screening);

/// Searches one effect more on top of the best of `causes` and adds what it finds. A first effect that was a compromise
/// between two is exchanged: what was added to it is fitted alone, and searched on top of, until the pair stays.
/// False: nothing was found that is better than the best before.
bool search_further(Problem& problem, const Fit& nominal, std::vector<Cause>& causes);

}  // namespace teres
