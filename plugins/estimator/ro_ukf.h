// Reduced-order unscented Kalman filter (Moireau and Chapelle, "Reduced-order unscented Kalman filtering with
// application to parameter identification in large-dimensional systems", ESAIM: COCV 17, 2011; Algorithm 1 of
// Nikolaev and Cotin, 2020).
//
// The augmented state X = [x; theta] has n = num_state + p entries, but its covariance has rank p only:
//
//     P = L U^-1 L^T = A A^T        A = L U^-1/2, n x p        (never formed: n x n)
//
// One step, r sigma points (columns); the filter never calls the model:
//
//     X = filter.sigma_points();   advance each column;   filter.predict(X);                     X: n x r
//     Z = observe each column;     filter.correct(z, Z, noise_variance);                         Z: m x r
//
// add_process_noise() before sigma_points() lets the parameters walk. Without it (and with the transformed
// parameters written back into X) the order of operations is that of the recorded peer runs.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <span>

#include "plugins/estimator/ensemble_correction.h"
#include "plugins/estimator/sigma_points.h"

namespace teres {

class RoUkf {
  public:
    struct Options {
        SigmaPointKind points = SigmaPointKind::kSimplex;
        double star_lambda = 1.0;  ///< >= 0, star only
    };

    /// The state x starts known exactly: its uncertainty is that of the parameters, carried over by the
    /// model. P_theta: p x p symmetric positive definite.
    RoUkf(const Eigen::VectorXd& x, const Eigen::VectorXd& theta, const Eigen::MatrixXd& P_theta, Options options);
    RoUkf(const Eigen::VectorXd& x, const Eigen::VectorXd& theta, const Eigen::MatrixXd& P_theta)
        : RoUkf(x, theta, P_theta, Options{}) {}

    Eigen::Index num_state() const { return mean_.size() - num_parameters(); }
    Eigen::Index num_parameters() const { return points_.unit.rows(); }
    Eigen::Index num_points() const { return points_.unit.cols(); }

    /// Parameters walk: P_theta += Q (p x p, positive semi-definite). The state follows along the sensitivity
    /// G = A_x A_theta^-1 that the model has shown so far, P = [G; 1] (P_theta + Q) [G; 1]^T, so the rank
    /// stays p.
    void add_process_noise(const Eigen::MatrixXd& Q);
    /// P_theta <- D P_theta D, D = diag(factor): forgetting when every factor is 1/sqrt(lambda) > 1.
    void scale_parameters(const Eigen::VectorXd& factor);
    /// theta += delta, and the state with it along G (used to put the mean back between bounds).
    void shift_parameters(const Eigen::VectorXd& delta);
    /// The model no longer reacts to parameter i: it is N(mean, stdev^2), apart from state and other parameters.
    void release_parameter(Eigen::Index i, double mean, double stdev);

    /// Columns mean + spread A I_i. Valid until the next call of sigma_points(). A spread below 1 keeps the
    /// points where a stiff model still converges (the scaled transform); predict and innovation divide it
    /// out again.
    const Eigen::MatrixXd& sigma_points(double spread = 1.0);
    /// X: the sigma points after the model, n x r.  mean = sum w_i X_i,  A = sum w_i (X_i - mean) I_i^T
    void predict(const Eigen::Ref<const Eigen::MatrixXd>& X);

    /// z: m, may hold NaN in rows that will not be used. Z: m x r.  Y = sum w_i (Z_i - E[Z]) I_i^T
    Innovation innovation(const Eigen::VectorXd& z, const Eigen::Ref<const Eigen::MatrixXd>& Z) const;
    /// noise_variance: m, > 0. used: m flags, empty means all rows.
    Correction correct(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                       std::span<const std::uint8_t> used = {});
    Correction correct(const Eigen::VectorXd& z, const Eigen::Ref<const Eigen::MatrixXd>& Z,
                       const Eigen::VectorXd& noise_variance, std::span<const std::uint8_t> used = {});

    const Eigen::VectorXd& mean() const { return mean_; }  ///< X = [x; theta]
    auto state() const { return mean_.head(num_state()); }
    auto theta() const { return mean_.tail(num_parameters()); }
    const Eigen::MatrixXd& root() const { return A_; }  ///< A, n x p
    Eigen::MatrixXd covariance() const;                 ///< parameter block of P, p x p

    /// Restarts the mechanical state, e.g. after a gap in the recording; parameters and their covariance
    /// stay.
    void set_state(const Eigen::VectorXd& x);

  private:
    Eigen::MatrixXd inverse_parameter_root() const;  // A_theta^+: G = A_x A_theta^+
    void replace_parameter_root(const Eigen::MatrixXd& root);

    SigmaPoints points_;
    Eigen::VectorXd mean_;
    Eigen::MatrixXd A_;
    Eigen::MatrixXd X_;
    Eigen::MatrixXd deviations_, next_A_;  // workspaces, n x r and n x p
    double spread_ = 1.0;
};

}  // namespace teres
