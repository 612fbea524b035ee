// What a named mechanical cause may get wrong of its own form: real breathing is no sinusoid, a real law no single
// term. While a further effect is searched, these columns stand beside those of our model's own error (Whitener), so
// that the further effect must explain what the first one could not with another course in time or with shares of its
// own modes.
//
//     a(t) = h(with the effect) - h(without it)        s(t): leading course of a, largest magnitude 1
//     a s, a s^2          a law that bends                da/dt               a course that lags
//     a cos(k pi t / T)   one that grows or fades         modes of a          a place or direction that is a little off
//
// each with a standard deviation of `share` of the size of a.
#pragma once

#include <Eigen/Dense>

#include "plugins/diagnosis/simulator.h"

namespace teres {

/// Columns for every mechanical effect of `at` [m] whose form is not exact (effect_table.h), full trajectory rows;
/// those of effects without which the body does not hold are left out. `with`: the trajectory at `at`. Leaves the
/// simulator's base at `at`.
Eigen::MatrixXd form_columns(Simulator& simulator, const Assumption& at, const Eigen::VectorXd& with, double share);

}  // namespace teres
