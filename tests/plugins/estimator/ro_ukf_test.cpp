#include "plugins/estimator/ro_ukf.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "plugins/estimator/parameter_map.h"
#include "plugins/estimator/probability.h"
#include "tests/plugins/estimator/linear_model.h"

using namespace teres;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::KalmanFilter;
using test::LinearModel;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

struct Comparison {
    SigmaPointKind points;
    bool process_noise;
    bool missing_rows;
};

// Full covariance of the reduced filter, for comparison only.
MatrixXd full_covariance(const RoUkf& filter) {
    return filter.root() * filter.root().transpose();
}

void run_beside_kalman_filter(const Comparison& c) {
    const Index nx = 6, p = 3, m = 5;
    const LinearModel model = LinearModel::random(nx, p, m, 7);
    const MatrixXd A = model.augmented(), H = model.observed();
    std::mt19937 engine(11);
    std::normal_distribution<double> normal;

    MatrixXd P_theta = MatrixXd::Identity(p, p);
    P_theta(0, 1) = P_theta(1, 0) = 0.3;
    const MatrixXd Q =
        c.process_noise ? MatrixXd(VectorXd::LinSpaced(p, 0.01, 0.05).asDiagonal()) : MatrixXd::Zero(p, p);
    RoUkf filter(VectorXd::Zero(nx), VectorXd::Ones(p), P_theta, {c.points, 1.0});
    KalmanFilter kalman{VectorXd::Zero(nx + p), MatrixXd::Zero(nx + p, nx + p)};
    kalman.x.tail(p).setOnes();
    kalman.P.bottomRightCorner(p, p) = P_theta;

    VectorXd x = VectorXd::Zero(nx), theta = VectorXd::Random(p);
    for (int step = 0; step < 50; ++step) {
        x = model.F * x + model.B * theta;
        VectorXd z = model.H * x;
        for (Index i = 0; i < m; ++i) z(i) += std::sqrt(model.noise_variance(i)) * normal(engine);
        std::vector<std::uint8_t> used(m, 1);
        if (c.missing_rows)
            for (Index i = 0; i < m; ++i)
                if ((step + i) % 3 == 0) {
                    z(i) = kNaN;
                    used[static_cast<std::size_t>(i)] = 0;
                }

        // Noise of the parameters that the state has followed all along: Gamma Q Gamma^T, Gamma = [P_x,theta
        // P_theta^-1; 1].
        MatrixXd Gamma = MatrixXd::Zero(nx + p, p);
        Gamma.topRows(nx) = kalman.P.topRightCorner(nx, p) * kalman.P.bottomRightCorner(p, p).inverse();
        Gamma.bottomRows(p).setIdentity();
        kalman.P += Gamma * Q * Gamma.transpose();
        kalman.predict(A, MatrixXd::Zero(nx + p, nx + p));
        const double nis = kalman.correct(z, H, model.noise_variance);

        if (c.process_noise) filter.add_process_noise(Q);
        const MatrixXd X = A * filter.sigma_points();
        filter.predict(X);
        const Correction correction = filter.correct(z, H * X, model.noise_variance, used);

        ASSERT_LT((filter.mean() - kalman.x).norm(), 1e-10 * (1.0 + kalman.x.norm())) << "step " << step;
        ASSERT_LT((full_covariance(filter) - kalman.P).norm(), 1e-10) << "step " << step;
        ASSERT_NEAR(correction.nis, nis, 1e-9 * (1.0 + nis)) << "step " << step;
    }
}

}  // namespace

TEST(RoUkf, EqualsKalmanFilterOnLinearModel) {
    for (SigmaPointKind points : {SigmaPointKind::kSimplex, SigmaPointKind::kStar})
        for (bool process_noise : {false, true})
            for (bool missing : {false, true}) run_beside_kalman_filter({points, process_noise, missing});
}

// Six polynomial-spring parameters of the peer's liver: nothing moves at first, so row 1 is the mean of the
// clamped sigma points and their variance. Digits as the peer printed them.
TEST(RoUkf, ReproducesPeersFirstRowFromPriorAlone) {
    std::vector<ParameterSpec> specs;
    for (double mean : {1000.0, 1000.0, 1500.0, 1000.0, 1000.0, 1500.0})
        specs.push_back({.name = "a",
                         .transform = Transform::kProject,
                         .median = mean,
                         .stdev = 1000.0394,
                         .lower = 1.0,
                         .upper = 1e6});
    const ParameterMap map = ParameterMap::make(specs).value();
    RoUkf filter(VectorXd(0), map.prior_mean(), map.prior_covariance());
    filter.predict(map.read_back(filter.sigma_points()));
    const double expected[] = {1124.55748629, 1165.90457331, 1613.19687489, 1195.36073581, 1202.33208825, 1635.7980361};
    for (Index i = 0; i < 6; ++i) EXPECT_NEAR(filter.theta()(i), expected[i], 5e-8) << i;  // last printed digit
    EXPECT_NEAR(filter.covariance()(0, 0), 627096.404814, 5e-6);
}

TEST(RoUkf, CovarianceStaysPositiveDefiniteAfterTenThousandSteps) {
    const Index nx = 12, p = 4, m = 9;
    LinearModel model = LinearModel::random(nx, p, m, 3);
    model.noise_variance *= 1e-10;  // very good markers: the hard case for covariance differences
    const MatrixXd A = model.augmented(), H = model.observed();
    RoUkf filter(VectorXd::Zero(nx), VectorXd::Zero(p), MatrixXd::Identity(p, p));
    const MatrixXd Q = 1e-8 * MatrixXd::Identity(p, p);
    std::mt19937 engine(5);
    std::normal_distribution<double> normal;
    double smallest = 1.0;
    for (int step = 0; step < 10000; ++step) {
        if (step % 10 == 0) filter.add_process_noise(Q);
        const MatrixXd X = A * filter.sigma_points();
        filter.predict(X);
        const VectorXd z = VectorXd::NullaryExpr(m, [&] { return normal(engine); });
        filter.correct(z, H * X, model.noise_variance);
        ASSERT_TRUE(filter.mean().allFinite()) << step;
        if (step % 100 == 0) {
            const MatrixXd P = filter.covariance();
            ASSERT_LT((P - P.transpose()).norm(), 1e-14 * P.norm());
            smallest = std::min(smallest, Eigen::SelfAdjointEigenSolver<MatrixXd>(P).eigenvalues()(0));
        }
    }
    EXPECT_GT(smallest, 0.0);
}

TEST(RoUkf, NisOfConsistentFilterIsChiSquare) {
    const Index nx = 4, p = 2, m = 6;
    const LinearModel model = LinearModel::random(nx, p, m, 21);
    const MatrixXd A = model.augmented(), H = model.observed();
    std::mt19937 engine(2);
    std::normal_distribution<double> normal;
    double sum_nis = 0.0, sum_error = 0.0;
    const int runs = 200, steps = 20;
    for (int run = 0; run < runs; ++run) {
        // Truth drawn from the filter's own prior.
        const VectorXd theta = VectorXd::NullaryExpr(p, [&] { return normal(engine); });
        RoUkf filter(VectorXd::Zero(nx), VectorXd::Zero(p), MatrixXd::Identity(p, p));
        VectorXd x = VectorXd::Zero(nx);
        for (int step = 0; step < steps; ++step) {
            x = model.F * x + model.B * theta;
            VectorXd z = model.H * x;
            for (Index i = 0; i < m; ++i) z(i) += std::sqrt(model.noise_variance(i)) * normal(engine);
            const MatrixXd X = A * filter.sigma_points();
            filter.predict(X);
            sum_nis += filter.correct(z, H * X, model.noise_variance).nis;
        }
        const VectorXd error = theta - filter.theta();
        sum_error += error.dot(filter.covariance().inverse() * error);
    }
    const double nis_dof = static_cast<double>(runs * steps * m), error_dof = static_cast<double>(runs * p);
    EXPECT_GT(sum_nis, chi_square_quantile(0.005, nis_dof));
    EXPECT_LT(sum_nis, chi_square_quantile(0.995, nis_dof));
    EXPECT_GT(sum_error, chi_square_quantile(0.005, error_dof));
    EXPECT_LT(sum_error, chi_square_quantile(0.995, error_dof));
}

TEST(RoUkf, ForgettingScalesParametersAndStateAlike) {
    const LinearModel model = LinearModel::random(5, 2, 4, 9);
    RoUkf filter(VectorXd::Zero(5), VectorXd::Zero(2), MatrixXd::Identity(2, 2));
    filter.predict(model.augmented() * filter.sigma_points());
    const MatrixXd before = full_covariance(filter);
    filter.scale_parameters(VectorXd::Constant(2, std::sqrt(2.0)));
    EXPECT_LT((full_covariance(filter) - 2.0 * before).norm(), 1e-12 * before.norm());
}

TEST(RoUkf, ShiftOfParametersCarriesTheStateAlongTheSensitivity) {
    const LinearModel model = LinearModel::random(5, 2, 4, 9);
    RoUkf filter(VectorXd::Zero(5), VectorXd::Ones(2), MatrixXd::Identity(2, 2));
    filter.predict(model.augmented() * filter.sigma_points());
    const VectorXd delta = VectorXd::LinSpaced(2, 0.5, -2.0);
    const VectorXd before = filter.mean();
    filter.shift_parameters(delta);
    EXPECT_LT((filter.state() - before.head(5) - model.B * delta).norm(), 1e-12);
    EXPECT_LT((filter.theta() - before.tail(2) - delta).norm(), 1e-14);
}

// A clamped parameter under the peer's convention loses its variance (that is what the recorded runs show);
// process noise must wake it up again instead of dividing by zero.
TEST(RoUkf, ProcessNoiseWakesFrozenParameter) {
    RoUkf filter(VectorXd::Zero(1), VectorXd::Zero(2), MatrixXd::Identity(2, 2));
    MatrixXd X = filter.sigma_points();
    X.row(2).setConstant(8.0);
    X.row(0) = 3.0 * X.row(1);
    filter.predict(X);
    ASSERT_EQ(filter.covariance()(1, 1), 0.0);
    filter.add_process_noise(0.25 * MatrixXd::Identity(2, 2));
    EXPECT_NEAR(filter.covariance()(1, 1), 0.25, 1e-12);
    EXPECT_NEAR(filter.covariance()(0, 0), 1.25, 1e-12);
    EXPECT_NEAR((filter.root() * filter.root().transpose())(0, 0), 9.0 * 1.25, 1e-11);
}
