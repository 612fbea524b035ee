// What our own model's error explains of what a fit leaves, carried to where nothing was fitted (the posterior mean of
// a Kennedy-O'Hagan discrepancy):
//
//     c = argmin |S^{-1/2} (r - D c)|^2 + |c|^2  over the fitted numbers,   S = diag(s_i^2)
//     markers += D c,   validation points += D_p c
//
// D: columns of the discrepancy ensemble. Here they count against all numbers, not as nu of them (Whitener): what is
// asked is where the body is, not which hypothesis is likelier.
#pragma once

#include <Eigen/Dense>

#include "plugins/diagnosis/discrepancy.h"
#include "plugins/diagnosis/whitener.h"

namespace teres {

/// Coefficients c from a full trajectory of observed minus simulated [m], 0 where lost.
Eigen::VectorXd learned_error(const Whitener& whitener, const Discrepancy& discrepancy,
                              const Eigen::VectorXd& residual_m);

}  // namespace teres
