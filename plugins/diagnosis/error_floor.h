// What stays of the whitened cost when nothing is wrong: the stated noise, and the error of our own model that neither
// ligaments nor discrepancy columns take up. Scores compare what is above the noise, so that many noisy numbers do not
// hide a cause:
//
//     above(c) = max(c - noise, 0) + model
//     model    = n model_error + share ||(I + J J^T)^-1/2 S^-1/2 D||^2     S^-1/2: without the discrepancy columns D
#pragma once

#include <algorithm>

#include "plugins/diagnosis/calibration.h"
#include "plugins/diagnosis/discrepancy.h"
#include "plugins/diagnosis/whitener.h"

namespace teres {

struct ErrorFloor {
    double noise = 0.0;  ///< cost of the stated noise alone
    double model = 1.0;  ///< more that remains on controls

    double above(double cost) const { return std::max(cost - noise, 0.0) + model; }
    double total() const { return noise + model; }
    /// The cost c for which above(c) is this.
    double cost_of(double above) const { return noise + above - model; }
};

/// J: whitened derivatives of the nominal parameters (the ligaments take up what they can).
ErrorFloor error_floor(const Whitener& whitener, const Discrepancy& discrepancy, const Eigen::MatrixXd& J,
                       double noise_m, const Calibration& calibration);

}  // namespace teres
