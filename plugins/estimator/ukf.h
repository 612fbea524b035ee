// Unscented Kalman filter with a full covariance, for small states: the parameters alone (the model's state
// is common to all points and advanced once more with the corrected parameters), or a small state with its
// parameters.
//
//     X = filter.sigma_points();  advance each column;  filter.predict(X);          X: n x r     state that
//     moves filter.add_process_noise(Q);  X = filter.sigma_points();                                   redraw
//     with the noise Z = observe each column;  filter.correct(z, Z, noise_variance);               Z: m x r
//
// Parameters only: no predict; X = sigma_points(), one model step from the common state for each column,
// correct.
//     P = S S^T, square-root form throughout (ensemble_correction.h).
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <span>

#include "plugins/estimator/ensemble_correction.h"
#include "plugins/estimator/sigma_points.h"

namespace teres {

class Ukf {
  public:
    struct Options {
        SigmaPointKind points = SigmaPointKind::kSimplex;
        double star_lambda = 1.0;  ///< >= 0, star only
    };

    /// P: n x n symmetric positive semi-definite.
    Ukf(const Eigen::VectorXd& mean, const Eigen::MatrixXd& P, Options options);
    Ukf(const Eigen::VectorXd& mean, const Eigen::MatrixXd& P) : Ukf(mean, P, Options{}) {}

    Eigen::Index size() const { return mean_.size(); }
    Eigen::Index num_points() const { return points_.unit.cols(); }

    void add_process_noise(const Eigen::MatrixXd& Q);      ///< P += Q
    void scale_covariance(const Eigen::VectorXd& factor);  ///< P <- D P D, D = diag(factor)
    void shift_mean(const Eigen::VectorXd& delta);
    /// Entry i becomes N(mean, stdev^2), independent of the others.
    void release(Eigen::Index i, double mean, double stdev);

    /// Columns mean + spread S I_i. Valid until the next call of sigma_points(). A spread below 1 keeps the
    /// points where a stiff model still converges (the scaled transform); predict and innovation divide it
    /// out again.
    const Eigen::MatrixXd& sigma_points(double spread = 1.0);
    /// X: the sigma points after the model, n x r. Covariance from the points about their mean.
    void predict(const Eigen::Ref<const Eigen::MatrixXd>& X);

    /// Z: m x r, observed from the points of the last sigma_points() (or given to predict() after it).
    Innovation innovation(const Eigen::VectorXd& z, const Eigen::Ref<const Eigen::MatrixXd>& Z) const;
    Correction correct(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                       std::span<const std::uint8_t> used = {});
    Correction correct(const Eigen::VectorXd& z, const Eigen::Ref<const Eigen::MatrixXd>& Z,
                       const Eigen::VectorXd& noise_variance, std::span<const std::uint8_t> used = {});

    const Eigen::VectorXd& mean() const { return mean_; }
    Eigen::MatrixXd covariance() const { return S_ * S_.transpose(); }

  private:
    SigmaPoints points_;
    Eigen::VectorXd mean_;
    Eigen::MatrixXd S_;  // lower triangular
    Eigen::MatrixXd X_;
    Eigen::MatrixXd D_;  // sqrt(w_i) (X_i - mean), n x r; empty when S_ has changed since
    double spread_ = 1.0;
};

}  // namespace teres
