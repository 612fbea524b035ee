#include "plugins/estimator/ro_ukf.h"

#include <limits>

#include "core/check.h"

namespace teres {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

RoUkf::RoUkf(const VectorXd& x, const VectorXd& theta, const MatrixXd& P_theta, Options options)
    : points_(make_sigma_points(options.points, theta.size(), options.star_lambda)),
      mean_(x.size() + theta.size()),
      A_(MatrixXd::Zero(x.size() + theta.size(), theta.size())) {
    TERES_CHECK(P_theta.rows() == theta.size() && P_theta.cols() == theta.size());
    mean_ << x, theta;
    A_.bottomRows(theta.size()) = lower_root(P_theta);
    next_A_ = A_;
}

MatrixXd RoUkf::inverse_parameter_root() const {
    const Index p = num_parameters();
    // Rows scaled to 1, so that the rank decision does not depend on the units of the parameters.
    const MatrixXd A_theta = A_.bottomRows(p);
    VectorXd scale = A_theta.rowwise().norm();
    for (Index i = 0; i < p; ++i) scale(i) = scale(i) > 0.0 ? 1.0 / scale(i) : 0.0;
    const MatrixXd scaled = scale.asDiagonal() * A_theta;
    const Eigen::CompleteOrthogonalDecomposition<MatrixXd> solver(scaled);
    return solver.pseudoInverse() * scale.asDiagonal();
}

void RoUkf::replace_parameter_root(const MatrixXd& root) {
    const MatrixXd turn = inverse_parameter_root() * root;
    next_A_.topRows(num_state()).noalias() = A_.topRows(num_state()) * turn;
    next_A_.bottomRows(num_parameters()) = root;
    A_.swap(next_A_);
}

void RoUkf::add_process_noise(const MatrixXd& Q) {
    const Index p = num_parameters();
    TERES_CHECK(Q.rows() == p && Q.cols() == p);
    MatrixXd stack(2 * p, p);
    stack.topRows(p) = A_.bottomRows(p).transpose();
    stack.bottomRows(p) = lower_root(Q).transpose();
    replace_parameter_root(lower_root_of_gram(stack));
}

void RoUkf::scale_parameters(const VectorXd& factor) {
    TERES_CHECK(factor.size() == num_parameters());
    replace_parameter_root(factor.asDiagonal() * A_.bottomRows(num_parameters()));
}

void RoUkf::shift_parameters(const VectorXd& delta) {
    TERES_CHECK(delta.size() == num_parameters());
    if (delta.isZero(0.0)) return;
    const VectorXd along = inverse_parameter_root() * delta;
    mean_.head(num_state()).noalias() += A_.topRows(num_state()) * along;
    mean_.tail(num_parameters()) += delta;
}

void RoUkf::release_parameter(Index i, double mean, double stdev) {
    MatrixXd P = covariance();
    P.row(i).setZero();
    P.col(i).setZero();
    P(i, i) = stdev * stdev;
    const MatrixXd root = lower_root(P);
    MatrixXd others = root;  // the state follows all but i
    others.row(i).setZero();
    replace_parameter_root(others);
    A_.bottomRows(num_parameters()) = root;
    mean_(num_state() + i) = mean;
}

const MatrixXd& RoUkf::sigma_points(double spread) {
    TERES_CHECK(spread > 0.0);
    spread_ = spread;
    X_.noalias() = spread * A_ * points_.unit;
    X_.colwise() += mean_;
    return X_;
}

void RoUkf::predict(const Eigen::Ref<const MatrixXd>& X) {
    TERES_CHECK(X.rows() == mean_.size() && X.cols() == num_points());
    mean_.noalias() = X * points_.weights;
    deviations_ = (X.colwise() - mean_) * (points_.weights / spread_).asDiagonal();
    A_.noalias() = deviations_ * points_.unit.transpose();
}

Innovation RoUkf::innovation(const VectorXd& z, const Eigen::Ref<const MatrixXd>& Z) const {
    TERES_CHECK(Z.rows() == z.size() && Z.cols() == num_points());
    const VectorXd z_mean = Z * points_.weights;
    const VectorXd weights = points_.observation_factor / spread_ * points_.weights;
    return {z - z_mean, (Z.colwise() - z_mean) * weights.asDiagonal() * points_.unit.transpose()};
}

Correction RoUkf::correct(const Innovation& innovation, const VectorXd& noise_variance,
                          std::span<const std::uint8_t> used) {
    Correction correction = ensemble_correction(innovation, noise_variance, used);
    mean_.noalias() += A_ * correction.weights;
    next_A_.noalias() = A_ * correction.root;
    A_.swap(next_A_);
    return correction;
}

Correction RoUkf::correct(const VectorXd& z, const Eigen::Ref<const MatrixXd>& Z, const VectorXd& noise_variance,
                          std::span<const std::uint8_t> used) {
    return correct(innovation(z, Z), noise_variance, used);
}

MatrixXd RoUkf::covariance() const {
    const auto A_theta = A_.bottomRows(num_parameters());
    return A_theta * A_theta.transpose();
}

void RoUkf::set_state(const VectorXd& x) {
    TERES_CHECK(x.size() == num_state());
    mean_.head(num_state()) = x;
}

}  // namespace teres
