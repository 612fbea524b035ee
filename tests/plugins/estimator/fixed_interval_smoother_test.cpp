#include "plugins/estimator/fixed_interval_smoother.h"

#include <gtest/gtest.h>

#include <random>

#include "plugins/estimator/ukf.h"

using namespace teres;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Independent truth: all frames at once. theta_0 ~ N(m, P), theta_{k+1} = theta_k + N(0, Q), z_k = H_k
// theta_k + N(0, R): the posterior of the stacked theta is one linear least-squares problem.
TEST(FixedIntervalSmoother, EqualsTheBatchLeastSquaresSolution) {
    const Index p = 2, frames = 12, m = 3;
    std::mt19937 engine(6);
    std::normal_distribution<double> normal;
    const VectorXd m0 = VectorXd::Constant(p, 0.4), R = VectorXd::LinSpaced(m, 0.1, 0.3);
    const MatrixXd P0 = 0.5 * MatrixXd::Identity(p, p), Q = 0.03 * MatrixXd::Identity(p, p);

    Ukf filter(m0, P0);
    std::vector<FilteredFrame> filtered;
    MatrixXd information = MatrixXd::Zero(p * frames, p * frames);
    VectorXd rhs = VectorXd::Zero(p * frames);
    information.topLeftCorner(p, p) += P0.inverse();
    rhs.head(p) += P0.inverse() * m0;
    for (Index k = 0; k < frames; ++k) {
        const MatrixXd H = MatrixXd::NullaryExpr(m, p, [&] { return normal(engine); });
        const VectorXd z = VectorXd::NullaryExpr(m, [&] { return normal(engine); });
        if (k > 0) {
            filter.add_process_noise(Q);
            const MatrixXd W = Q.inverse();
            information.block(p * k, p * k, p, p) += W;
            information.block(p * (k - 1), p * (k - 1), p, p) += W;
            information.block(p * k, p * (k - 1), p, p) -= W;
            information.block(p * (k - 1), p * k, p, p) -= W;
        }
        const MatrixXd Ri = VectorXd(R.cwiseInverse()).asDiagonal();
        information.block(p * k, p * k, p, p) += H.transpose() * Ri * H;
        rhs.segment(p * k, p) += H.transpose() * Ri * z;

        const MatrixXd predicted = filter.covariance();
        const MatrixXd Z = H * filter.sigma_points();
        filter.correct(z, Z, R);
        filtered.push_back({filter.mean(), filter.covariance(), predicted});
    }
    const MatrixXd covariance = information.inverse();
    const VectorXd mean = covariance * rhs;
    const std::vector<SmoothedFrame> smoothed = smooth(filtered);
    ASSERT_EQ(smoothed.size(), static_cast<std::size_t>(frames));
    for (Index k = 0; k < frames; ++k) {
        const SmoothedFrame& frame = smoothed[static_cast<std::size_t>(k)];
        EXPECT_LT((frame.mean - mean.segment(p * k, p)).norm(), 1e-10) << k;
        EXPECT_LT((frame.covariance - covariance.block(p * k, p * k, p, p)).norm(), 1e-10) << k;
    }
}

TEST(FixedIntervalSmoother, TakesEmptyAndSingleRecordings) {
    EXPECT_TRUE(smooth({}).empty());
    const FilteredFrame one{VectorXd::Ones(1), MatrixXd::Ones(1, 1), MatrixXd::Ones(1, 1)};
    EXPECT_EQ(smooth({one})[0].mean, one.mean);
}
