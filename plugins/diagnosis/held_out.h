// How far the gap closes on data that were neither fitted nor chosen with.
#pragma once

#include <Eigen/Dense>
#include <array>

#include "plugins/diagnosis/recording.h"

namespace teres {

struct Shrinkage {
    double before_m = 0.0, after_m = 0.0;  ///< rms 3-D distance, stated noise taken off
    double fraction = 0.0;                 ///< 1 - after / before
    std::array<double, 2> ci95{};          ///< bootstrap over markers and blocks of frames, and what other points add
};

/// rms of 3-D distances over `rows` (whole markers), less 3 noise^2.
double gap_rms_m(const Eigen::VectorXd& observed, const Eigen::VectorXd& simulated,
                 const std::vector<Eigen::Index>& rows, double noise_m);
Shrinkage shrinkage(const Recording& recording, const std::vector<Eigen::Index>& rows, const Eigen::VectorXd& before,
                    const Eigen::VectorXd& after);

}  // namespace teres
