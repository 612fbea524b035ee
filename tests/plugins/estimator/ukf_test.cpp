#include "plugins/estimator/ukf.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "plugins/estimator/ro_ukf.h"
#include "tests/plugins/estimator/linear_model.h"

using namespace teres;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::KalmanFilter;
using test::LinearModel;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

void run_beside_kalman_filter(SigmaPointKind points, bool process_noise, bool missing_rows) {
    const Index nx = 3, p = 2, n = nx + p, m = 4;
    const LinearModel model = LinearModel::random(nx, p, m, 17);
    const MatrixXd A = model.augmented(), H = model.observed();
    MatrixXd Q = MatrixXd::Zero(n, n);
    if (process_noise) Q = 0.02 * (MatrixXd::Identity(n, n) + 0.3 * MatrixXd::Ones(n, n));
    Ukf filter(VectorXd::Ones(n), MatrixXd::Identity(n, n), {points, 1.0});
    KalmanFilter kalman{VectorXd::Ones(n), MatrixXd::Identity(n, n)};
    std::mt19937 engine(4);
    std::normal_distribution<double> normal;
    for (int step = 0; step < 50; ++step) {
        VectorXd z = VectorXd::NullaryExpr(m, [&] { return normal(engine); });
        std::vector<std::uint8_t> used(m, 1);
        if (missing_rows) {
            z(step % m) = kNaN;
            used[static_cast<std::size_t>(step % m)] = 0;
        }
        kalman.predict(A, Q);
        const double nis = kalman.correct(z, H, model.noise_variance);

        filter.predict(A * filter.sigma_points());
        if (process_noise) filter.add_process_noise(Q);
        const MatrixXd Z = H * filter.sigma_points();
        const Correction correction = filter.correct(z, Z, model.noise_variance, used);

        ASSERT_LT((filter.mean() - kalman.x).norm(), 1e-10) << "step " << step;
        ASSERT_LT((filter.covariance() - kalman.P).norm(), 1e-10) << "step " << step;
        ASSERT_NEAR(correction.nis, nis, 1e-9 * (1.0 + nis)) << "step " << step;
    }
}

// Two springs in series with a non-linear answer: stands for a model of which only the parameters are
// filtered.
VectorXd nonlinear(const VectorXd& theta) {
    VectorXd z(3);
    z << std::exp(-theta(0)), theta(0) * theta(1), std::sin(theta(1));
    return z;
}

}  // namespace

TEST(Ukf, EqualsKalmanFilterOnLinearModel) {
    for (SigmaPointKind points : {SigmaPointKind::kSimplex, SigmaPointKind::kStar})
        for (bool process_noise : {false, true})
            for (bool missing : {false, true}) run_beside_kalman_filter(points, process_noise, missing);
}

// Parameters only, as the peer's notes write it: z_i, zbar, Pxz, Pzz sums about the mean, K = Pxz (Pzz +
// R)^-1, s += K (z - zbar), P -= K Pxz^T; here in plain matrices beside the square-root filter.
TEST(Ukf, ParameterOnlyStepEqualsCovarianceFormulas) {
    const Index p = 2;
    VectorXd s = VectorXd::Constant(p, 0.7);
    MatrixXd P = 0.3 * MatrixXd::Identity(p, p);
    P(0, 1) = P(1, 0) = 0.1;
    Ukf filter(s, P);
    const VectorXd R = VectorXd::LinSpaced(3, 0.01, 0.03);
    const SigmaPoints unit = make_sigma_points(SigmaPointKind::kSimplex, p);
    for (int step = 0; step < 30; ++step) {
        VectorXd z(3);
        z << 0.4 + 0.01 * step, 0.6, 0.9 - 0.02 * step;

        const MatrixXd points = (P.llt().matrixL() * unit.unit).colwise() + s;
        MatrixXd Z(3, 3);
        for (Index i = 0; i < 3; ++i) Z.col(i) = nonlinear(points.col(i));
        const VectorXd zbar = Z.rowwise().mean(), mean = points.rowwise().mean();
        const MatrixXd dX = points.colwise() - mean, dZ = Z.colwise() - zbar;
        const MatrixXd Pxz = dX * dZ.transpose() / 3.0;
        const MatrixXd S = dZ * dZ.transpose() / 3.0 + MatrixXd(R.asDiagonal());
        const MatrixXd K = Pxz * S.inverse();
        s = mean + K * (z - zbar);
        P -= K * Pxz.transpose();

        const MatrixXd X = filter.sigma_points();
        MatrixXd Zf(3, 3);
        for (Index i = 0; i < 3; ++i) Zf.col(i) = nonlinear(X.col(i));
        filter.correct(z, Zf, R);
        ASSERT_LT((filter.mean() - s).norm(), 1e-11) << step;
        ASSERT_LT((filter.covariance() - P).norm(), 1e-11) << step;
    }
}

// With the simplex and parameters only, the reduced-order filter is the same filter.
TEST(Ukf, EqualsReducedOrderFilterOnParameters) {
    const MatrixXd P = MatrixXd::Identity(2, 2), Q = 0.01 * MatrixXd::Identity(2, 2);
    Ukf full(VectorXd::Constant(2, 0.5), P);
    RoUkf reduced(VectorXd(0), VectorXd::Constant(2, 0.5), P);
    const VectorXd R = VectorXd::Constant(3, 0.02), z = nonlinear(VectorXd::Constant(2, 1.1));
    for (int step = 0; step < 20; ++step) {
        full.add_process_noise(Q);
        reduced.add_process_noise(Q);
        const MatrixXd X = full.sigma_points(), Xr = reduced.sigma_points();
        ASSERT_LT((X - Xr).norm(), 1e-11);
        MatrixXd Z(3, 3);
        for (Index i = 0; i < 3; ++i) Z.col(i) = nonlinear(X.col(i));
        reduced.predict(Xr);
        full.correct(z, Z, R);
        reduced.correct(z, Z, R);
        ASSERT_LT((full.mean() - reduced.mean()).norm(), 1e-11) << step;
        ASSERT_LT((full.covariance() - reduced.covariance()).norm(), 1e-11) << step;
    }
    EXPECT_LT((full.mean() - VectorXd::Constant(2, 1.1)).norm(), 0.05);
}

TEST(Ukf, CovarianceStaysPositiveDefiniteAfterTenThousandSteps) {
    const Index n = 5;
    const LinearModel model = LinearModel::random(3, 2, 6, 8);
    const MatrixXd A = model.augmented(), H = model.observed();
    Ukf filter(VectorXd::Zero(n), MatrixXd::Identity(n, n), {SigmaPointKind::kStar, 1.0});
    const VectorXd R = 1e-9 * model.noise_variance;
    double smallest = 1.0;
    for (int step = 0; step < 10000; ++step) {
        filter.predict(A * filter.sigma_points());
        filter.add_process_noise(1e-7 * MatrixXd::Identity(n, n));
        const MatrixXd Z = H * filter.sigma_points();
        filter.correct(VectorXd::Constant(6, std::sin(0.1 * step)), Z, R);
        if (step % 100 == 0)
            smallest =
                std::min(smallest, Eigen::SelfAdjointEigenSolver<MatrixXd>(filter.covariance()).eigenvalues()(0));
    }
    EXPECT_TRUE(filter.mean().allFinite());
    EXPECT_GT(smallest, 0.0);
}
