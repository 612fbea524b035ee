// The correction both filters share, in square-root form. With the state covariance P = A A^T, the observed
// deviations Y = H A (so Y Y^T is the predicted covariance of the observation) and R diagonal:
//
//     w    = argmin |R^-1/2 (residual - Y w)|^2 + |w|^2       x+ = x + A w
//     C C^T = (1 + Y^T R^-1 Y)^-1                             P+ = (A C)(A C)^T
//     nis  = residual^T (Y Y^T + R)^-1 residual = the minimum above
//
// One QR of [R^-1/2 Y; 1] gives all three: no m x m matrix, no difference of covariances, P+ is SPD by
// construction.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <span>

namespace teres {

/// What the observation says against the prediction.
struct Innovation {
    Eigen::VectorXd residual;    ///< z - E[Z], m
    Eigen::MatrixXd deviations;  ///< Y, m x q
};

struct Correction {
    double nis = 0.0;           ///< normalised innovation squared of the used rows
    Eigen::Index num_used = 0;  ///< its degrees of freedom
    Eigen::VectorXd weights;    ///< w, q
    Eigen::MatrixXd root;       ///< C, q x q lower triangular, positive diagonal
};

/// noise_variance: m (> 0 in used rows). used: m flags, empty means all. Rows not used may hold anything, NaN
/// too.
Correction ensemble_correction(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                               std::span<const std::uint8_t> used = {});

/// Lower triangular T, diagonal >= 0, with T T^T = M^T M.
Eigen::MatrixXd lower_root_of_gram(const Eigen::MatrixXd& M);

/// Lower Cholesky root of a symmetric positive semi-definite matrix; tiny negative eigenvalues of rounding
/// are cut.
Eigen::MatrixXd lower_root(const Eigen::MatrixXd& P);

}  // namespace teres
