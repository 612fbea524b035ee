// Onsets, windows and places in which a simulation jumps rather than bends: a pattern search over an effect's shape
// parameters by first-order responses, each accepted move confirmed by a simulation.
#pragma once

#include "plugins/diagnosis/joint_fit.h"

namespace teres {

/// `fit` must be the simulator's base; it stays so.
void improve_shapes(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit);

}  // namespace teres
