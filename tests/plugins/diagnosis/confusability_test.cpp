// What stands in for what, by hand: signatures along two axes, no nuisance but where a test says so.
#include "plugins/diagnosis/confusability.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

// The camera's registration moves the first number, a slip the second, "noise" both alike.
class ConfusabilityOfThreeSensors : public ::testing::Test {
  protected:
    ConfusabilityOfThreeSensors() {
        const auto add = [&](std::size_t entry, double x, double y) {
            EffectScreening effect;
            effect.entry = entry;
            effect.signature = Eigen::MatrixXd(2, 1);
            effect.signature << x, y;
            screening_.effects.push_back(effect);
        };
        add(registration_, 100.0, 0.0);
        add(slip_, 0.0, 100.0);
        add(noise_, 100.0 * std::sqrt(0.5), 100.0 * std::sqrt(0.5));
    }
    Confusability table(const Eigen::MatrixXd& nuisance) const { return confusability(screening_, effects_, nuisance); }
    double overlap_of(const Confusability& table, std::size_t a, std::size_t b) const {
        const auto at = [&](std::size_t entry) {
            return std::find(table.entries.begin(), table.entries.end(), entry) - table.entries.begin();
        };
        return table.overlap(at(a), at(b));
    }
    // At gap `nominal` in place of what leaves 0.5 above a floor of 1.
    std::vector<std::array<std::size_t, 2>> instead_of_noise(double nominal) const {
        return table(none_).pairs_instead(noise_, Eigen::VectorXd::Constant(1, 2.0), nominal, 0.5, ErrorFloor{0.0, 1.0},
                                          {});
    }

    test::ToyBody body_;
    test::ToyCamera camera_;
    const EffectTable effects_{body_, &camera_, {}};
    const std::size_t registration_ = effects_.find("registration"), slip_ = effects_.find("marker_slip"),
                      noise_ = effects_.find("noise");
    const Eigen::MatrixXd none_ = Eigen::MatrixXd::Zero(2, 1);
    Screening screening_;
};

TEST_F(ConfusabilityOfThreeSensors, OverlapIsTheShareThatIsReproduced) {
    const Confusability c = table(none_);
    EXPECT_NEAR(overlap_of(c, noise_, registration_), 0.5, 1e-3);
    EXPECT_NEAR(overlap_of(c, registration_, slip_), 0.0, 1e-12);
    EXPECT_TRUE(c.rivals(noise_, 0.9).empty());
}

TEST_F(ConfusabilityOfThreeSensors, WhatTheNuisanceTakesUpTellsNothingApart) {
    Eigen::MatrixXd second = none_;
    second(1) = 1e4;
    const Confusability c = table(second);
    EXPECT_NEAR(overlap_of(c, noise_, registration_), 1.0, 1e-3);
    EXPECT_EQ(c.rivals(noise_, 0.9), std::vector{registration_});
}

// Both leave 1e-4 of what is explained (S = 1e4): 22.5 ln((1.5 + 1e-4 n)/1.5) is 0.06 nats at n = 41, 2 at 1,395.
TEST_F(ConfusabilityOfThreeSensors, APairIsDeclaredWhereItsRestDoesNotShow) {
    const std::vector pair{std::array{std::min(registration_, slip_), std::max(registration_, slip_)}};
    EXPECT_EQ(instead_of_noise(41.0), pair);
    EXPECT_EQ(instead_of_noise(1.3e3).size(), 1u);
    EXPECT_EQ(instead_of_noise(1.5e3).size(), 0u);
    EXPECT_EQ(instead_of_noise(0.7).size(), 0u) << "each alone leaves no more that shows";
}

// A sensor of two amplitudes: only what it does in its own direction must be reproduced.
TEST_F(ConfusabilityOfThreeSensors, WhatCountsIsTheDirectionThatWasNamed) {
    Confusability c = table(none_);
    for (Signature& s : c.sensors)
        if (s.entry == noise_) s.G = s.W = 100.0 * Eigen::MatrixXd::Identity(2, 2);
    const auto instead = [&](double first, double second) {
        return c.pairs_instead(noise_, Eigen::Vector2d(first, second), 41.0, 0.5, ErrorFloor{0.0, 1.0}, {}).size();
    };
    EXPECT_EQ(instead(1.0, 1.0), 1u);
    EXPECT_EQ(instead(1.0, 0.0), 0u) << "the registration alone reproduces that";
    EXPECT_EQ(
        c.pairs_instead(effects_.find("gravity"), Eigen::Vector3d::Ones(), 41.0, 0.5, ErrorFloor{0.0, 1.0}, {}).size(),
        0u);
}

}  // namespace
}  // namespace teres
