// The white part of residuals that are drawn: known deviations.
#include "plugins/diagnosis/white_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace teres {
namespace {

constexpr Eigen::Index kMarkers = 14, kChannels = 3 * kMarkers, kFrames = 50;

std::vector<Eigen::Index> all_rows() {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index k = 0; k < kChannels * kFrames; ++k) rows.push_back(k);
    return rows;
}

Eigen::VectorXd white(double deviation, unsigned seed = 3) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0.0, deviation);
    Eigen::VectorXd out(kChannels * kFrames);
    for (double& x : out) x = normal(random);
    return out;
}

TEST(WhiteNoise, OfNoiseAloneIsItsDeviation) {
    EXPECT_NEAR(white_noise_factor(white(1.7), all_rows(), kMarkers), 1.7, 0.05);
}

// Its own leading modes are no motion of the markers: of few frames they hold a quarter of it.
TEST(WhiteNoise, OfFewFramesIsItsDeviation) {
    constexpr Eigen::Index kFew = kChannels * 30;
    std::vector<Eigen::Index> rows = all_rows();
    rows.resize(kFew);
    double mean = 0.0;
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const double factor = white_noise_factor(white(1.7, seed).head(kFew), rows, kMarkers);
        EXPECT_NEAR(factor, 1.7, 0.15) << seed;
        mean += factor / 20.0;
    }
    EXPECT_NEAR(mean, 1.7, 0.02) << "four standard deviations of the mean";
}

// Two courses that change from frame to frame and move all markers.
TEST(WhiteNoise, WhatMovesManyMarkersAtOnceIsNot) {
    Eigen::VectorXd residual = white(1.7);
    for (Eigen::Index k = 0; k < residual.size(); ++k) {
        const auto c = static_cast<double>(k % kChannels), f = static_cast<double>(k / kChannels);
        residual(k) += 4.0 * std::cos(c) * std::sin(2.2 * f) + 3.0 * std::sin(0.7 * c) * std::sin(1.3 * f);
    }
    EXPECT_NEAR(white_noise_factor(residual, all_rows(), kMarkers), 1.7, 0.07);
}

// A deviation of 1.7 where 1.25 is stated (a variance of 1.5625 per number) beside what else is expected to scatter.
TEST(WhiteNoise, IsComparedWithWhatIsStated) {
    const Whitener whitener(all_rows(), Eigen::VectorXd::Ones(kChannels * kFrames),
                            Eigen::MatrixXd(kChannels * kFrames, 0));
    const double stated = 1.25 * 1.25 * static_cast<double>(kChannels * kFrames);
    EXPECT_NEAR(stated_noise_factor(white(1.7), whitener, stated, kMarkers), 1.7 / 1.25, 0.04);
    EXPECT_EQ(stated_noise_factor(white(1.0), whitener, stated, kMarkers), 1.0) << "less than stated is no finding";
    EXPECT_EQ(stated_noise_factor(white(1.3), whitener, stated, kMarkers), 1.0) << "nor is a little more";
    EXPECT_EQ(stated_noise_factor(white(1.7), whitener, 0.0, kMarkers), 1.0) << "none is stated";
}

// Of ten frames four weigh a fifth, because the body is next to another equilibrium there, and three weigh much: the
// noise of these is no motion of all markers.
TEST(WhiteNoise, IsTheSameWhereverFramesWeighLess) {
    Eigen::VectorXd sigma(kChannels * kFrames);
    for (Eigen::Index k = 0; k < sigma.size(); ++k) {
        const Eigen::Index f = k / kChannels % 10;
        sigma(k) = f < 4 ? 5.0 : f < 7 ? 1.0 : 1.8;
    }
    const Whitener whitener(all_rows(), sigma, Eigen::MatrixXd(kChannels * kFrames, 0));
    const double stated = 1.25 * 1.25 * sigma.cwiseInverse().squaredNorm();
    double mean = 0.0;
    for (unsigned seed = 1; seed <= 20; ++seed)
        mean += stated_noise_factor(white(1.7, seed).cwiseQuotient(sigma), whitener, stated, kMarkers) / 20.0;
    EXPECT_NEAR(mean, 1.7 / 1.25, 0.03);
}

}  // namespace
}  // namespace teres
