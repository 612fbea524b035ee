// Stiffness, damping and mass found together on an oscillator whose motion is known in closed form.
#include "plugins/diagnosis/swing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "tests/support/posed_problem.h"
#include "tests/support/toy_oscillator.h"

namespace teres {
namespace {

constexpr double kNoise = 1e-4;

class SwingTest : public ::testing::Test, protected test::PosedProblem {
  protected:
    using Toy = test::ToyOscillator;

    void observe(const std::vector<EffectInstance>& truth, const std::vector<const char*>& excluded = {}) {
        effects_.emplace(body_, nullptr, excluded);
        pose(body_, nullptr, *effects_, Toy::motion(truth), kNoise);
        problem_->floor = {count(), 0.3 * count()};
    }
    const std::vector<double>& values(const Fit& fit, const char* id) const {
        const auto found = std::find_if(fit.at.effects.begin(), fit.at.effects.end(),
                                        [&](const ActiveEffect& effect) { return effect.entry == effects_->find(id); });
        return found->values;
    }
    static std::vector<std::size_t> sorted(std::vector<std::size_t> entries) {
        std::sort(entries.begin(), entries.end());
        return entries;
    }
    static double mass_at_end(const std::vector<double>& inertia) {
        return inertia[0] * std::pow(inertia[1] / Toy::kLength, 2);
    }

    Toy body_;
    std::optional<EffectTable> effects_;
    const std::vector<double> stiff_{2.1}, damped_{1.5, 0.004}, heavy_{0.9, Toy::kLength, 0.0, 0.0};
    const std::vector<EffectInstance> all_three_{
        {Toy::kStiffness, stiff_}, {Toy::kDamping, damped_}, {Toy::kInertia, heavy_}};
};

// Twice as stiff, damped, nearly twice as heavy: half a swing beyond the nominal body after a third of a second. The
// place of the mass makes up for its size, and one damping for the other: 2 g = r + T K/M.
TEST_F(SwingTest, AllThreeAreFoundFromFarOff) {
    observe(all_three_);
    const auto swing = fit_swing(*problem_, nominal_);
    ASSERT_TRUE(swing);
    EXPECT_LT(swing->fit.misfit, 1e-4 * nominal_.misfit);
    EXPECT_NEAR(values(swing->fit, "stiffness")[0], 2.1, 0.01);
    EXPECT_NEAR(mass_at_end(values(swing->fit, "inertia")), 0.9, 0.02);
    const std::vector<double>& damping = values(swing->fit, "damping");
    const double K_over_M = 2.1 * Toy::kSpring / (Toy::kMass + 0.9);
    EXPECT_NEAR(damping[0] + damping[1] * K_over_M, 1.5 + 0.004 * K_over_M, 0.05);
}

// Softer, damped and heavier, all of usual size; with another force one of them could be spared, but the others would
// be less usual. They are the best set, and what the ladder of the report climbs by is fitted: its first effect, its
// first two.
TEST_F(SwingTest, TheyAreTheBestSetOnTopOfItsBestParts) {
    const std::vector<double> soft{0.7}, heavier{0.3, Toy::kLength, 0.0, 0.0};
    observe({{Toy::kStiffness, soft}, {Toy::kDamping, damped_}, {Toy::kInertia, heavier}});
    const std::vector<Cause> causes = search_from_swing(*problem_, nominal_);
    ASSERT_FALSE(causes.empty());
    const Cause& best =
        *std::max_element(causes.begin(), causes.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
    EXPECT_EQ(sorted(best.entries),
              sorted({effects_->find("stiffness"), effects_->find("damping"), effects_->find("inertia")}));
    for (const std::ptrdiff_t size : {1, 2}) {
        const std::vector<std::size_t> first(best.entries.begin(), best.entries.begin() + size);
        EXPECT_TRUE(std::any_of(causes.begin(), causes.end(), [&](const Cause& c) { return c.entries == first; }));
    }
}

// Half the force on a damped body: a stiffer one that is as much heavier moves the same way, which takes one effect
// more.
TEST_F(SwingTest, WhatExplainsAsMuchWithLessIsFoundInTheirPlace) {
    const std::vector<double> half{-0.5};
    observe({{Toy::kDamping, damped_}, {Toy::kLoadScale, half}});
    const std::vector<Cause> causes = search_from_swing(*problem_, nominal_);
    ASSERT_FALSE(causes.empty());
    const Cause& best =
        *std::max_element(causes.begin(), causes.end(), [](const auto& a, const auto& b) { return a.score < b.score; });
    EXPECT_EQ(sorted(best.entries), sorted({effects_->find("damping"), effects_->find("load_scale")}));
    EXPECT_NEAR(values(best.fit, "load_scale")[0], -0.5, 0.01);
}

// Of two of them both are found if the third cannot be there.
TEST_F(SwingTest, TwoAreFoundWhereTheThirdCannotBe) {
    body_.held = true;
    observe({{Toy::kStiffness, stiff_}, {Toy::kInertia, heavy_}});
    const auto swing = fit_swing(*problem_, nominal_);
    ASSERT_TRUE(swing);
    EXPECT_EQ(swing->fit.at.effects.size(), 2u);
    EXPECT_NEAR(values(swing->fit, "stiffness")[0], 2.1, 0.01);
    EXPECT_NEAR(mass_at_end(values(swing->fit, "inertia")), 0.9, 0.02);
}

// What the nominal model explains needs none of them, and one alone is what every search begins with.
TEST_F(SwingTest, NothingIsSearchedWhereNothingIsMissingOrOneIsLeft) {
    observe({});
    EXPECT_TRUE(search_from_swing(*problem_, nominal_).empty());
    body_.held = true;
    observe({{Toy::kStiffness, stiff_}}, {"inertia"});
    EXPECT_FALSE(fit_swing(*problem_, nominal_));
    EXPECT_TRUE(search_from_swing(*problem_, nominal_).empty());
}

}  // namespace
}  // namespace teres
