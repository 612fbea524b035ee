#include "plugins/estimator/sigma_points.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace teres;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

void expect_unit_gaussian(const SigmaPoints& points, Eigen::Index p) {
    EXPECT_NEAR(points.weights.sum(), 1.0, 1e-14);
    EXPECT_GE(points.weights.minCoeff(), 0.0);
    EXPECT_LT((points.unit * points.weights).norm(), 1e-13) << "mean, p = " << p;
    const MatrixXd covariance = points.unit * points.weights.asDiagonal() * points.unit.transpose();
    EXPECT_LT((covariance - MatrixXd::Identity(p, p)).norm(), 1e-12) << "covariance, p = " << p;
}

}  // namespace

TEST(SigmaPoints, SimplexCarriesMeanAndCovarianceExactly) {
    for (Eigen::Index p : {1, 2, 3, 8, 20, 60}) {
        const SigmaPoints points = make_sigma_points(SigmaPointKind::kSimplex, p);
        EXPECT_EQ(points.unit.cols(), p + 1);
        expect_unit_gaussian(points, p);
    }
}

TEST(SigmaPoints, StarCarriesMeanAndCovarianceExactly) {
    for (Eigen::Index p : {1, 2, 3, 8, 20, 60})
        for (double lambda : {0.0, 0.5, 1.0, 3.0}) {
            const SigmaPoints points = make_sigma_points(SigmaPointKind::kStar, p, lambda);
            EXPECT_EQ(points.unit.cols(), 2 * p + 1);
            expect_unit_gaussian(points, p);
        }
}

TEST(SigmaPoints, SimplexPointsAreEquallyFarFromTheMeanAndFromEachOther) {
    const MatrixXd I = make_sigma_points(SigmaPointKind::kSimplex, 5).unit;
    for (Eigen::Index i = 0; i < I.cols(); ++i) {
        EXPECT_NEAR(I.col(i).norm(), std::sqrt(5.0), 1e-13);
        for (Eigen::Index j = 0; j < i; ++j) EXPECT_NEAR((I.col(i) - I.col(j)).norm(), std::sqrt(12.0), 1e-13);
    }
}

// By hand for p = 2: b = 2/3; row 0: -+s0, s0 = 1/sqrt(4/3); row 1: s = 1/sqrt(2/3 * 6) = 1/2, then -2 s;
// times sqrt(2).
TEST(SigmaPoints, SimplexOfTwoMatchesPenAndPaper) {
    const MatrixXd I = make_sigma_points(SigmaPointKind::kSimplex, 2).unit;
    MatrixXd expected(2, 3);
    expected << -std::sqrt(0.75), std::sqrt(0.75), 0.0, 0.5, 0.5, -1.0;
    EXPECT_LT((I - std::sqrt(2.0) * expected).norm(), 1e-14);
}

TEST(SigmaPoints, ConstantWeightStarIsUnbiasedForLambdaHalfOnly) {
    const SigmaPoints half = make_sigma_points(SigmaPointKind::kStarConstantWeight, 4, 0.5);
    expect_unit_gaussian(half, 4);
    const SigmaPoints one = make_sigma_points(SigmaPointKind::kStarConstantWeight, 4, 1.0);
    EXPECT_NEAR(one.weights.sum(), 0.9, 1e-14);  // 9 points of weight 1/10
}

// r = p + 1 points at p/r of their distance; state deviations weighted by 1/r, observed ones by 1/(r-1) =
// 1/p.
TEST(SigmaPoints, MixedWeightsShrinkTheSimplexAndWeighObservationsMore) {
    const auto mixed = make_sigma_points(SigmaPointKind::kSimplexMixedWeights, 3);
    const auto plain = make_sigma_points(SigmaPointKind::kSimplex, 3);
    EXPECT_LT((mixed.unit - 0.75 * plain.unit).norm(), 1e-15);
    EXPECT_EQ(mixed.weights, plain.weights);
    EXPECT_NEAR(mixed.observation_factor * mixed.weights(0), 1.0 / 3.0, 1e-15);
    EXPECT_EQ(plain.observation_factor, 1.0);
}
