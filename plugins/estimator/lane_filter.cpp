#include "plugins/estimator/lane_filter.h"

#include "plugins/estimator/ro_ukf.h"
#include "plugins/estimator/ukf.h"

namespace teres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd diagonal(const VectorXd& stdev) {
    return stdev.cwiseAbs2().asDiagonal();
}

class ReducedOrderLaneFilter final : public LaneFilter {
  public:
    ReducedOrderLaneFilter(const VectorXd& x, const VectorXd& theta, const VectorXd& stdev, SigmaPointKind points)
        : filter_(x, theta, diagonal(stdev), {points, 1.0}) {}

    Index num_lanes() const override { return filter_.num_points(); }
    void widen(const VectorXd& factor, const VectorXd& noise_variance) override {
        if ((factor.array() != 1.0).any()) filter_.scale_parameters(factor);
        if ((noise_variance.array() != 0.0).any()) filter_.add_process_noise(noise_variance.asDiagonal());
    }
    void shift_parameters(const VectorXd& delta) override { filter_.shift_parameters(delta); }
    void release_parameter(Index i, double mean, double stdev) override { filter_.release_parameter(i, mean, stdev); }
    void draw(double spread, MatrixXd& lanes, MatrixXd& theta) override {
        X_ = filter_.sigma_points(spread);
        lanes = X_.topRows(filter_.num_state());
        theta = X_.bottomRows(filter_.num_parameters());
    }
    void predict(const MatrixXd& lanes) override {
        X_.topRows(filter_.num_state()) = lanes;
        filter_.predict(X_);
    }
    Innovation innovation(const VectorXd& z, const MatrixXd& Z) const override { return filter_.innovation(z, Z); }
    Correction correct(const Innovation& innovation, const VectorXd& noise_variance,
                       std::span<const std::uint8_t> used) override {
        return filter_.correct(innovation, noise_variance, used);
    }
    bool needs_mean_step() const override { return false; }
    void set_state(const VectorXd& x) override { filter_.set_state(x); }
    Eigen::Ref<const VectorXd> state() const override { return filter_.state(); }
    VectorXd theta() const override { return filter_.theta(); }
    MatrixXd covariance() const override { return filter_.covariance(); }

  private:
    RoUkf filter_;
    MatrixXd X_;
};

class ParameterLaneFilter final : public LaneFilter {
  public:
    ParameterLaneFilter(const VectorXd& x, const VectorXd& theta, const VectorXd& stdev, SigmaPointKind points)
        : filter_(theta, diagonal(stdev), {points, 1.0}), x_(x) {}

    Index num_lanes() const override { return filter_.num_points(); }
    void widen(const VectorXd& factor, const VectorXd& noise_variance) override {
        if ((factor.array() != 1.0).any()) filter_.scale_covariance(factor);
        if ((noise_variance.array() != 0.0).any()) filter_.add_process_noise(noise_variance.asDiagonal());
    }
    void shift_parameters(const VectorXd& delta) override { filter_.shift_mean(delta); }
    void release_parameter(Index i, double mean, double stdev) override { filter_.release(i, mean, stdev); }
    void draw(double spread, MatrixXd& lanes, MatrixXd& theta) override {
        theta = filter_.sigma_points(spread);
        lanes = x_.replicate(1, filter_.num_points());
    }
    void predict(const MatrixXd&) override {}  // parameters do not move by themselves
    Innovation innovation(const VectorXd& z, const MatrixXd& Z) const override { return filter_.innovation(z, Z); }
    Correction correct(const Innovation& innovation, const VectorXd& noise_variance,
                       std::span<const std::uint8_t> used) override {
        return filter_.correct(innovation, noise_variance, used);
    }
    bool needs_mean_step() const override { return true; }
    void set_state(const VectorXd& x) override { x_ = x; }
    Eigen::Ref<const VectorXd> state() const override { return x_; }
    VectorXd theta() const override { return filter_.mean(); }
    MatrixXd covariance() const override { return filter_.covariance(); }

  private:
    Ukf filter_;
    VectorXd x_;
};

}  // namespace

std::unique_ptr<LaneFilter> make_reduced_order_lane_filter(const VectorXd& x, const VectorXd& theta,
                                                           const VectorXd& stdev, SigmaPointKind points) {
    return std::make_unique<ReducedOrderLaneFilter>(x, theta, stdev, points);
}

std::unique_ptr<LaneFilter> make_parameter_lane_filter(const VectorXd& x, const VectorXd& theta, const VectorXd& stdev,
                                                       SigmaPointKind points) {
    return std::make_unique<ParameterLaneFilter>(x, theta, stdev, points);
}

}  // namespace teres
