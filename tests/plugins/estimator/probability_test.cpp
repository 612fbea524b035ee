#include "plugins/estimator/probability.h"

#include <gtest/gtest.h>

#include <cmath>

using namespace teres;

// Values of printed tables (Abramowitz and Stegun 26.2, 26.8).
TEST(Probability, MatchesPrintedTables) {
    EXPECT_NEAR(normal_cdf(1.0), 0.841344746068543, 1e-14);
    EXPECT_NEAR(normal_cdf(-3.0), 0.00134989803163009, 1e-16);
    EXPECT_NEAR(probit(0.975), 1.95996398454005, 1e-12);
    EXPECT_NEAR(probit(1e-9), -5.99780701500769, 1e-10);
    EXPECT_NEAR(chi_square_quantile(0.95, 1.0), 3.84145882069412, 1e-10);
    EXPECT_NEAR(chi_square_quantile(0.5, 3.0), 2.36597388437534, 1e-10);
    EXPECT_NEAR(chi_square_quantile(0.99, 10.0), 23.2092511589544, 1e-9);
    EXPECT_NEAR(chi_square_quantile(0.99, 100.0), 135.806723, 1e-5);
}

// With two degrees of freedom chi-square is exponential: 1 - exp(-x/2).
TEST(Probability, ChiSquareOfTwoIsExponential) {
    for (double x : {0.01, 0.5, 2.0, 7.0, 40.0}) EXPECT_NEAR(chi_square_cdf(x, 2.0), 1.0 - std::exp(-0.5 * x), 1e-14);
}

TEST(Probability, QuantilesInvertTheDistribution) {
    for (double k : {1.0, 3.0, 120.0, 5000.0})
        for (double p : {1e-4, 0.3, 0.9, 0.9999}) EXPECT_NEAR(chi_square_cdf(chi_square_quantile(p, k), k), p, 1e-11);
    for (double p : {1e-6, 0.2, 0.5, 0.8}) EXPECT_NEAR(normal_cdf(probit(p)), p, 1e-14);
}

TEST(Probability, EndsOfTheIntervalStayFinite) {
    EXPECT_TRUE(std::isfinite(probit(0.0)));
    EXPECT_TRUE(std::isfinite(probit(1.0)));
    EXPECT_EQ(chi_square_quantile(0.0, 3.0), 0.0);
    EXPECT_TRUE(std::isfinite(chi_square_quantile(1.0, 3.0)));
}
