// The search for one effect, or for one more: screened by first order, the best refitted with everything free.
#pragma once

#include <vector>

#include "plugins/diagnosis/problem.h"

namespace teres {

/// Cost that `known` leaves because a mechanical cause never has quite the form of the catalogue's.
double form_error(Problem& problem, const Fit& nominal, const Cause& known);

/// Screens all effects on top of `known` (null: nothing) and refits the best; best score first. Effects that were only
/// screened keep their linear score.
std::vector<Cause> search(Problem& problem, const Fit& nominal, const Cause* known, Screening& screening);

}  // namespace teres
