#include "plugins/estimator/parameter_walk.h"

#include <gtest/gtest.h>

#include <cmath>

using Eigen::VectorXd;
using teres::ParameterWalk;

namespace {

VectorXd vector(double a, double b) {
    VectorXd v(2);
    v << a, b;
    return v;
}

}  // namespace

TEST(ParameterWalk, RandomWalkGrowsWithTimeInUnitsOfThePrior) {
    const ParameterWalk walk({.noise_per_sqrt_s = 0.1}, vector(2.0, 10.0));
    const auto change = walk.over(0.25, vector(0.5, 3.0), false);
    EXPECT_NEAR(change.noise_variance(0), 0.01 * 4.0 * 0.25, 1e-15);
    EXPECT_NEAR(change.noise_variance(1), 0.01 * 100.0 * 0.25, 1e-15);
    EXPECT_EQ(change.factor(0), 1.0);
}

TEST(ParameterWalk, NothingGrowsBeyondThePrior) {
    const ParameterWalk walk({.noise_per_sqrt_s = 5.0, .forgetting_time_s = 0.1, .reinflation = 3.0}, vector(1.0, 1.0));
    const VectorXd P = vector(0.2, 1.0);
    const auto change = walk.over(10.0, P, true);
    for (Eigen::Index i = 0; i < 2; ++i)
        EXPECT_NEAR(P(i) * change.factor(i) * change.factor(i) + change.noise_variance(i), 1.0, 1e-12);
}

TEST(ParameterWalk, ForgettingLosesWeightExponentially) {
    const ParameterWalk walk({.forgetting_time_s = 4.0}, vector(100.0, 100.0));
    EXPECT_NEAR(std::pow(walk.over(4.0, vector(1.0, 1.0), false).factor(0), 2), std::exp(1.0), 1e-12);
}

TEST(ParameterWalk, ReinflationMayExceedANarrowPriorWhenAsked) {
    const ParameterWalk walk({.reinflation = 0.0, .reinflation_stdev = 1.0}, vector(0.02, 0.02));
    EXPECT_NEAR(walk.over(0.01, vector(1e-4, 1e-4), true).noise_variance(0) + 1e-4, 1.0, 1e-12);
    EXPECT_EQ(walk.over(0.01, vector(1e-4, 1e-4), false).noise_variance(0), 0.0);
}
