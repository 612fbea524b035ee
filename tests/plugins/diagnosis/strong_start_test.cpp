// Starts at full size, by hand, and the best of them by its simulation.
#include "plugins/diagnosis/strong_start.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

using test::ToyBody;

struct Toy {
    ToyBody body;
    test::ToyCamera camera;
    EffectTable effects{body, &camera, {}};
};

TEST(StrongStart, GrowsTheCandidateToTheSideOfFirstOrder) {
    const Toy toy;
    EffectScreening gravity;
    gravity.entry = toy.effects.find("gravity");
    gravity.start = {gravity.entry, {0.01, -0.02, 0.0}};  // candidate 0.4, 0.4, 0.4; null 0
    const auto starts = strong_starts(toy.effects, gravity, {38.0, 70.0});
    ASSERT_EQ(starts.size(), 2u);
    EXPECT_EQ(starts[0].theta, (std::vector<double>{38.0, 70.0}));
    EXPECT_EQ(starts[0].effects[0].values, (std::vector<double>{0.4, -0.4, 0.4}));
    EXPECT_NEAR(starts[1].effects[0].values[1], -1.2, 1e-12);

    EffectScreening stiffness;
    stiffness.entry = toy.effects.find("stiffness");
    stiffness.start = {stiffness.entry, {0.9}};  // softer; candidate exp(0.5), null 1, logarithmic
    const auto softer = strong_starts(toy.effects, stiffness, {38.0, 70.0});
    EXPECT_NEAR(softer[0].effects[0].values[0], std::exp(-0.5), 1e-12);
    EXPECT_NEAR(softer[1].effects[0].values[0], std::exp(-1.5), 1e-12);
}

TEST(StrongStart, TriesEveryPlaceOfFewAndNoSensor) {
    const Toy toy;
    EffectScreening load;
    load.entry = toy.effects.find("unknown_load");
    for (std::size_t c = 0; c < 9; ++c) {
        const ActiveEffect full = toy.effects.candidate(load.entry, c);
        load.places.push_back({{full.values[3], full.values[4], 0.0}, 0.0, 0.0, full, c});
    }
    EXPECT_EQ(strong_starts(toy.effects, load, {}).size(), 18u);
    EffectScreening shift;
    shift.entry = toy.effects.find("registration");
    ASSERT_LT(shift.entry, toy.effects.size());
    shift.start = toy.effects.candidate(shift.entry, 0);
    EXPECT_TRUE(strong_starts(toy.effects, shift, {}).empty());
}

TEST(StrongStart, TheBestLeavesTheLeast) {
    Toy toy;
    Simulator simulator(toy.body, &toy.camera, toy.effects);
    const std::vector<double> theta{38.0, 70.0};
    const auto at = [&](double scale) { return Assumption{theta, {{toy.effects.find("stiffness"), {scale}}}}; };
    Eigen::VectorXd observed;
    ASSERT_TRUE(simulator.simulate(at(0.55), observed));
    std::vector<Eigen::Index> rows(static_cast<std::size_t>(observed.size()));
    for (std::size_t k = 0; k < rows.size(); ++k) rows[k] = static_cast<Eigen::Index>(k);
    const Whitener whitener(rows, Eigen::VectorXd::Constant(observed.size(), 1e-3),
                            Eigen::MatrixXd::Zero(observed.size(), 0));
    const auto best = best_strong_start(simulator, whitener, observed, {at(2.0), at(0.6), at(0.2)});
    ASSERT_TRUE(best);
    EXPECT_EQ(best->at.effects[0].values[0], 0.6);
    EXPECT_GT(best->misfit, 0.0);
    observed(4) = NAN;  // a lost marker counts for nothing
    EXPECT_TRUE(std::isfinite(best_strong_start(simulator, whitener, observed, {at(0.6)})->misfit));
    EXPECT_FALSE(best_strong_start(simulator, whitener, observed, {}));
}

}  // namespace
}  // namespace teres
