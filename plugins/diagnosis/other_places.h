// A place is found by descent, which ends in the nearest hollow: the best answer starts from other places as well.
#pragma once

#include "plugins/diagnosis/search.h"

namespace teres {

/// From the best places of the screening, from the best of another course in time and, if the effect is a force, from
/// where its line of action meets the surface elsewhere: what moves the body as a whole is the same from both sides,
/// push or pull. What fits best is kept in `cause`, scored, with the places that fit nearly as well.
void try_other_places(Problem& problem, const Fit& nominal, const Base* base, const Screening& screening, Cause& cause);

/// The effect acting from where its line of action (force_x, _y, _z, or the axis of the swing cos_x, ... sin_z, at
/// center_x, _y, _z) meets the surface at least `apart_m` from where it acts now; nothing for what is no force on the
/// surface.
std::vector<ActiveEffect> along_line_of_action(const Simulator& simulator, const ActiveEffect& effect, double apart_m);

}  // namespace teres
