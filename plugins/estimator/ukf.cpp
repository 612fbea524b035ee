#include "plugins/estimator/ukf.h"

#include "core/check.h"

namespace teres {

using Eigen::MatrixXd;
using Eigen::VectorXd;

Ukf::Ukf(const VectorXd& mean, const MatrixXd& P, Options options)
    : points_(make_sigma_points(options.points, mean.size(), options.star_lambda)), mean_(mean), S_(lower_root(P)) {}

void Ukf::add_process_noise(const MatrixXd& Q) {
    TERES_CHECK(Q.rows() == size() && Q.cols() == size());
    MatrixXd stack(2 * size(), size());
    stack << S_.transpose(), lower_root(Q).transpose();
    S_ = lower_root_of_gram(stack);
    D_.resize(0, 0);
}

void Ukf::scale_covariance(const VectorXd& factor) {
    TERES_CHECK(factor.size() == size());
    S_ = factor.asDiagonal() * S_;
    D_.resize(0, 0);
}

void Ukf::release(Eigen::Index i, double mean, double stdev) {
    MatrixXd P = covariance();
    P.row(i).setZero();
    P.col(i).setZero();
    P(i, i) = stdev * stdev;
    S_ = lower_root(P);
    D_.resize(0, 0);
    mean_(i) = mean;
}

void Ukf::shift_mean(const VectorXd& delta) {
    TERES_CHECK(delta.size() == size());
    mean_ += delta;
    D_.resize(0, 0);
}

const MatrixXd& Ukf::sigma_points(double spread) {
    TERES_CHECK(spread > 0.0);
    spread_ = spread;
    const VectorXd root_weights = points_.weights.cwiseSqrt();
    const MatrixXd deviations = S_ * points_.unit;
    X_ = (spread * deviations).colwise() + mean_;
    D_ = deviations * root_weights.asDiagonal();
    return X_;
}

void Ukf::predict(const Eigen::Ref<const MatrixXd>& X) {
    TERES_CHECK(X.rows() == size() && X.cols() == num_points());
    mean_ = X * points_.weights;
    D_ = (X.colwise() - mean_) * (points_.weights.cwiseSqrt() / spread_).asDiagonal();
    S_ = lower_root_of_gram(D_.transpose());
}

Innovation Ukf::innovation(const VectorXd& z, const Eigen::Ref<const MatrixXd>& Z) const {
    TERES_CHECK(Z.rows() == z.size() && Z.cols() == num_points());
    const VectorXd z_mean = Z * points_.weights;
    return {z - z_mean, (Z.colwise() - z_mean) * (points_.weights.cwiseSqrt() / spread_).asDiagonal()};
}

Correction Ukf::correct(const Innovation& innovation, const VectorXd& noise_variance,
                        std::span<const std::uint8_t> used) {
    TERES_CHECK(D_.cols() == num_points());  // points drawn since the covariance last changed
    Correction correction = ensemble_correction(innovation, noise_variance, used);
    mean_ += D_ * correction.weights;
    S_ = lower_root_of_gram((D_ * correction.root).transpose());
    D_.resize(0, 0);
    return correction;
}

Correction Ukf::correct(const VectorXd& z, const Eigen::Ref<const MatrixXd>& Z, const VectorXd& noise_variance,
                        std::span<const std::uint8_t> used) {
    return correct(innovation(z, Z), noise_variance, used);
}

}  // namespace teres
