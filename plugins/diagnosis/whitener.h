// Residuals of a recording in units in which they are white and of unit variance, if simulation and reality differ by
// noise and by the known error of our own model only:
//
//     r ~ N(0, S + D D^T),  S = diag(s_i^2),   D: columns of the discrepancy ensemble (coefficients N(0,1))
//     W = (I - U diag(1 - 1/sqrt(1 + d^2)) U^T) S^{-1/2},   S^{-1/2} D = U diag(d) V^T,   W (S + D D^T) W^T = I
//
// (a Kennedy-O'Hagan discrepancy whose prior has a physical basis; U spans few columns).
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

class Whitener {
  public:
    Whitener() = default;
    /// rows: indices of the used entries of a trajectory; sigma: one per used entry [m];
    /// discrepancy: full trajectory rows x columns (may have no columns) [m].
    Whitener(std::vector<Eigen::Index> rows, const Eigen::VectorXd& sigma, const Eigen::MatrixXd& discrepancy);

    Eigen::Index size() const { return static_cast<Eigen::Index>(rows_.size()); }
    const std::vector<Eigen::Index>& rows() const { return rows_; }
    const Eigen::VectorXd& inverse_sigma() const { return inverse_sigma_; }  ///< 1/s_i [1/m]
    /// Used entries of full trajectories (columns), whitened.
    Eigen::MatrixXd operator()(const Eigen::MatrixXd& trajectories) const;
    /// The share of used entries that the discrepancy columns explain best, taken off, not whitened [m].
    Eigen::VectorXd without_discrepancy(const Eigen::VectorXd& trajectory) const;

  private:
    std::vector<Eigen::Index> rows_;
    Eigen::VectorXd inverse_sigma_;
    Eigen::MatrixXd U_;
    Eigen::VectorXd shrink_;   // 1 - 1/sqrt(1 + d^2)
    Eigen::VectorXd explain_;  // d^2 / (1 + d^2)
};

}  // namespace teres
