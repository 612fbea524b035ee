// What stays of the whitened cost when nothing is wrong: the stated noise, and the error of our own model that neither
// ligaments nor discrepancy columns take up. Scores compare what is above the noise, so that many noisy numbers do not
// hide a cause:
//
//     above(c) = max(c - noise, 0) + model
//     model    = n model_error + share ||(I + J J^T)^-1/2 S^-1/2 D||^2     S^-1/2: without the discrepancy columns D
//
// The whitener takes up what lies in the directions of D: the share is what lies in none of them. With inertia a phase
// runs away, so that the columns tell the size of the error more than its shape: a larger share.
//
// Of the model's error hardly anything lies beside the span of the motion in time (motion_span.h), so what a hypothesis
// leaves there is compared on its own:
//
//     ln above = ln(max(c_in - noise_in, 0) + model) + ln(max(c_beside - noise_beside, 0) + model_beside)
//     model_beside = small shares of the model's error and of the noise, which may be misstated
#pragma once

#include <algorithm>

#include "plugins/diagnosis/calibration.h"
#include "plugins/diagnosis/discrepancy.h"
#include "plugins/diagnosis/whitener.h"

namespace teres {

/// What a hypothesis leaves.
struct Left {
    double cost = 0.0;    ///< whitened
    double beside = 0.0;  ///< the part of it that lies beside the span of the motion

    Left(double all, double part = 0.0) : cost(all), beside(part) {}
    double inside() const { return cost - beside; }
};

struct ErrorFloor {
    double noise = 0.0;         ///< cost of the stated noise alone
    double model = 1.0;         ///< more that remains on controls
    double noise_beside = 0.0;  ///< the part of `noise` beside the span of the motion
    double model_beside = 0.0;  ///< more that remains there; 0: inside and beside are not told apart

    bool split() const { return model_beside > 0.0; }
    /// By which hypotheses are compared.
    double log_above(const Left& left) const;
    /// What is left where neither part exceeds its noise and `model_share` of the model's error, but for `rest_share`
    /// of what is beyond.
    Left reached(const Left& from, double model_share, double rest_share) const;
    /// `left` with another cost: what is above the noise beside the motion changes like all that is above the noise.
    Left scaled(const Left& left, double cost) const;
    /// What of it noise and the model's error do not explain, each part on its own.
    Left beyond(const Left& left) const;
    bool explains(const Left& left) const { return beyond(left).cost <= 0.0; }
    /// The same floor with a share of the model's error.
    ErrorFloor with_model(double share) const;
    /// What is left beside noise of `factor` times the stated deviation.
    Left beside_noise(const Left& left, double factor) const;
    /// The same floor where the noise is that.
    ErrorFloor with_noise(double factor) const;
    double above(double cost) const { return std::max(cost - noise, 0.0) + model; }
    double total() const { return noise + model; }
};

/// J: whitened derivatives of the nominal parameters (the ligaments take up what they can). `dynamic`: with inertia.
ErrorFloor error_floor(const Whitener& whitener, const Discrepancy& discrepancy, const Eigen::MatrixXd& J,
                       double noise_m, bool dynamic, const Calibration& calibration);

/// The same, told apart: `free_share` of the used numbers lies beside the span of the motion.
ErrorFloor split_floor(ErrorFloor floor, double free_share, const Calibration& calibration);

}  // namespace teres
