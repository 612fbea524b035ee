// What a motion without inertia is made of in time.
#pragma once

#include <Eigen/Dense>

namespace teres {

/// Frames x columns of norm 1: a constant and the (at most eight) leading temporal modes of `motion` (channels x
/// frames) whose singular values exceed `least_share` of the first.
Eigen::MatrixXd temporal_modes(const Eigen::MatrixXd& motion, double least_share);

}  // namespace teres
