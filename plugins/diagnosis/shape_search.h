// Onsets, windows and indices at which a recording jumps rather than bends, so that a Jacobian does not see them: a
// pattern search over the shape parameters of the effect added last, if it is a sensor's or an event, by their
// responses; each accepted move is confirmed by a simulation.
#pragma once

#include "plugins/diagnosis/joint_fit.h"

namespace teres {

/// `fit` must be the simulator's base; it stays so.
void improve_shapes(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit);

}  // namespace teres
