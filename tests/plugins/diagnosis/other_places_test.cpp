// Places on the surface: a fit keeps its place there, and a force has a second one at the other end of its line of
// action. On a block whose faces are known.
#include "plugins/diagnosis/other_places.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "plugins/simulation/trajectory.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/white.h"

namespace teres {
namespace {

constexpr Point kSize{0.10, 0.04, 0.04};

Case block() {
    return test::clamped_block({.size_m = kSize,
                                .cells = {8, 3, 3},
                                .law = BodyLaw::kNeoHookean,
                                .youngs_modulus_pa = 15e3,
                                .poissons_ratio = 0.45,
                                .frames = 8,
                                .dt_s = 0.2,
                                .quasi_static = true,
                                .full_force_n = {0.0, 0.0, 0.0}});
}

struct Body {
    std::unique_ptr<Trajectory> mechanics = *Trajectory::make(block(), {});
    EffectTable effects{*mechanics, nullptr, {}};
    Simulator simulator{*mechanics, nullptr, effects};

    // A steady pull from before the first frame on.
    ActiveEffect pull(const Eigen::Vector3d& force_n, const Eigen::Vector3d& centre_m) const {
        const std::size_t entry = effects.find("unknown_load");
        ActiveEffect effect = effects.candidate(entry, 0);
        const auto set = [&](std::string_view name, double value) {
            for (std::size_t p = 0; p < effects[entry].parameters.size(); ++p)
                if (name == effects[entry].parameters[p].name) effect.values[p] = value;
        };
        const char* axes[] = {"x", "y", "z"};
        for (Eigen::Index a = 0; a < 3; ++a) {
            set(std::string("force_") + axes[a], force_n(a));
            set(std::string("center_") + axes[a], centre_m(a));
        }
        set("radius", 0.01);
        return effect;
    }
};

TEST(OtherPlaces, APlaceOnTheSurfaceIsSettledThere) {
    const Body body;
    ActiveEffect load = body.pull({0.0, 0.0, 0.1}, {0.06, 0.02, 0.033});
    body.mechanics->settle_effect(body.effects[load.entry].index, load.values);
    EXPECT_LT((*centre_of(body.effects[load.entry], load) - Eigen::Vector3d(0.06, 0.02, 0.04)).norm(), 1e-12);

    ActiveEffect inside = body.effects.candidate(body.effects.find("inclusion"), 0);
    const ActiveEffect before = inside;
    body.mechanics->settle_effect(body.effects[inside.entry].index, inside.values);
    EXPECT_EQ(inside, before);

    ActiveEffect failed = body.pull({0.0, 0.0, 0.1}, {0.06, std::nan(""), 0.033});
    body.mechanics->settle_effect(body.effects[failed.entry].index, failed.values);
    EXPECT_TRUE(std::isnan(*value_of(body.effects[failed.entry], failed, "center_y"))) << "a step that failed";
}

// From (0.06, 0.02, 0.04) along (0.3, 0, 1) through a block 40 mm high: out again at (0.048, 0.02, 0).
TEST(OtherPlaces, ALineOfActionLeavesTheBodyOnTheOtherSide) {
    const Body body;
    const ActiveEffect load = body.pull({0.03, 0.0, 0.1}, {0.06, 0.02, 0.04});
    const auto crossings = along_line_of_action(body.simulator, load, 0.02);
    ASSERT_EQ(crossings.size(), 1u);
    const EffectEntry& entry = body.effects[load.entry];
    EXPECT_LT((*centre_of(entry, crossings[0]) - Eigen::Vector3d(0.048, 0.02, 0.0)).norm(), 3e-3) << "half a step";
    EXPECT_EQ(*value_of(entry, crossings[0], "force_z"), 0.1);

    EXPECT_TRUE(along_line_of_action(body.simulator, load, 0.05).empty()) << "too near";
    EXPECT_TRUE(along_line_of_action(body.simulator, body.pull({0.0, 0.0, 0.0}, {0.06, 0.02, 0.04}), 0.02).empty());
    const ActiveEffect weight = body.effects.candidate(body.effects.find("gravity"), 0);
    EXPECT_TRUE(along_line_of_action(body.simulator, weight, 0.02).empty()) << "a weight has no place";
}

// A heart whose swings point along (0.3, 0, 1), the larger one nearly: out again at the same place.
TEST(OtherPlaces, AHeartsLineOfActionIsTheAxisOfItsSwing) {
    const Body body;
    const std::size_t index = body.effects.find("cardiac");
    ActiveEffect heart = body.effects.candidate(index, 0);
    const EffectEntry& entry = body.effects[index];
    const auto set = [&](std::string_view name, double value) {
        for (std::size_t p = 0; p < entry.parameters.size(); ++p)
            if (name == entry.parameters[p].name) heart.values[p] = value;
    };
    for (const auto& [name, value] : std::initializer_list<std::pair<const char*, double>>{{"cos_x", -0.06},
                                                                                           {"cos_y", 0.0},
                                                                                           {"cos_z", -0.2},
                                                                                           {"sin_x", 0.03},
                                                                                           {"sin_y", 0.001},
                                                                                           {"sin_z", 0.1},
                                                                                           {"center_x", 0.06},
                                                                                           {"center_y", 0.02},
                                                                                           {"center_z", 0.04}})
        set(name, value);
    const auto crossings = along_line_of_action(body.simulator, heart, 0.02);
    ASSERT_EQ(crossings.size(), 1u);
    EXPECT_LT((*centre_of(entry, crossings[0]) - Eigen::Vector3d(0.048, 0.02, 0.0)).norm(), 3e-3) << "half a step";
    EXPECT_EQ(*value_of(entry, crossings[0], "cos_z"), -0.2);
}

// Data of a pull on the upper face; the fit begins 18 mm beside it and below the face.
TEST(OtherPlaces, AFitMovesItsPlaceAlongTheSurface) {
    Body body;
    const std::vector<double> theta = prior_median(*body.mechanics).theta;
    const Assumption truth{theta, {body.pull({0.05, 0.02, 0.2}, {0.07, 0.02, 0.04})}};
    Eigen::VectorXd observed;
    ASSERT_TRUE(body.simulator.simulate(truth, observed));
    const Assumption start{theta, {body.pull({0.0, 0.0, 0.1}, {0.055, 0.012, 0.035})}};
    const Fit fit = fit_jointly(body.simulator, test::white(body.simulator, 1e-5), observed, start,
                                {.max_iterations = 30, .tolerance = 1e-4});
    ASSERT_TRUE(fit.usable);
    const ActiveEffect& load = fit.at.effects[0];
    const EffectEntry& entry = body.effects[load.entry];
    const Eigen::Vector3d centre = *centre_of(entry, load);
    EXPECT_NEAR(centre.z(), 0.04, 1e-12);
    EXPECT_LT((centre - Eigen::Vector3d(0.07, 0.02, 0.04)).norm(), 1e-3);
    EXPECT_NEAR(*value_of(entry, load, "force_z"), 0.2, 0.01);

    // It is sure not to leave the face, and not of where on it.
    const FitSpace space(*body.mechanics, body.effects, fit.at);
    const Eigen::VectorXd stdev = fit.stdev(1.0).cwiseProduct(space.prior_stdev());
    Eigen::Index x = 0;
    while (std::string_view(entry.parameters[static_cast<std::size_t>(x)].name) != "center_x") ++x;
    const Eigen::Index at = space.coordinate(0, static_cast<std::size_t>(x));
    EXPECT_GT(stdev(at), 1e-6);
    EXPECT_GT(stdev(at + 1), 1e-6);
    EXPECT_LT(stdev(at + 2), 1e-9);
    EXPECT_NEAR(fit.T(at + 2, at + 2), 0.0, 1e-9);
    EXPECT_NEAR(fit.T(at, at), 1.0, 1e-9);
}

constexpr double kUpper = 0.04;  // z of the upper face

// A pull of (0.05, 0, 0.3) N in the middle of the upper face, seen by a camera that is off by so much.
struct Pulled {
    Pulled(double noise, bool& made) : noise_m(noise) {
        made = body.simulator.simulate({theta, {body.pull({0.05, 0.0, 0.3}, {0.06, 0.02, kUpper})}}, observed);
        std::mt19937 random(1);
        std::normal_distribution<double> scatter(0.0, noise_m);
        for (double& number : observed) number += scatter(random);
    }
    // A fit that begins with `load`, then tried from other places: the corners and its line of action.
    Cause tried_elsewhere(const ActiveEffect& load, int iterations) {
        Recording recording = *make_recording(
            {"block", body.mechanics.get(), nullptr, {observed.data(), observed.data() + observed.size()}, noise_m, 1});
        const DiagnosisOptions options;
        Problem problem{body.simulator, recording, options, {}, test::white(body.simulator, noise_m)};
        const Fit nominal = problem.fit({theta, {}}, 0);
        Cause cause;
        cause.entries = {load.entry};
        cause.fit = problem.fit({theta, {load}}, iterations);
        EXPECT_TRUE(cause.fit.usable);
        Screening screening;
        screening.effects.resize(1);
        screening.effects[0].entry = cause.entries[0];
        screening.effects[0].start = cause.fit.at.effects[0];
        for (const Eigen::Vector3d& corner : {Eigen::Vector3d(0.0, 0.0, 0.0), Eigen::Vector3d(0.1, 0.04, kUpper)})
            screening.effects[0].places.push_back({corner, 0.0, 0.0, body.pull({0.0, 0.0, 1.0}, corner), 0});
        try_other_places(problem, nominal, nullptr, screening, cause);
        return cause;
    }
    Eigen::Vector3d centre(const Cause& cause) const {
        return *centre_of(body.effects[cause.entries[0]], cause.fit.at.effects[0]);
    }

    double noise_m;
    Body body;
    std::vector<double> theta = prior_median(*body.mechanics).theta;
    Eigen::VectorXd observed;
};

// Fitted as a push from below: what the data see of either is nearly the same. The search looks from the other side,
// too, finds the true place, and says of the other how likely it is: not at all with a camera that sees ten
// micrometres, hardly less than the best with one that is off by five millimetres.
TEST(OtherPlaces, APushFromBelowIsTriedAsAPullFromAbove) {
    for (const double noise_m : {1e-5, 5e-3}) {
        bool made = false;
        Pulled pulled(noise_m, made);
        ASSERT_TRUE(made);
        const Cause cause = pulled.tried_elsewhere(pulled.body.pull({0.05, 0.0, 0.3}, {0.06, 0.02, 0.0}), 8);
        const Eigen::Vector3d centre = pulled.centre(cause);
        if (noise_m < 1e-3) {
            EXPECT_LT((centre - Eigen::Vector3d(0.06, 0.02, kUpper)).norm(), 3e-3);
            EXPECT_TRUE(cause.other_places.empty());
        } else {
            ASSERT_FALSE(cause.other_places.empty());
            EXPECT_GT(cause.other_places[0].odds, 0.5);
            EXPECT_LE(cause.other_places[0].odds, 1.0);
            EXPECT_GT((Eigen::Map<const Eigen::Vector3d>(cause.other_places[0].center_m.data()) - centre).norm(), 0.02);
        }
    }
}

// Fitted near where it is, one step long (693): the push from below, fitted in six, leaves less by then (314), and in the
// end more (188).
TEST(OtherPlaces, TheBestTwoAreFittedOnBeforeOneIsChosen) {
    bool made = false;
    Pulled pulled(1e-4, made);
    ASSERT_TRUE(made);
    const Cause cause = pulled.tried_elsewhere(pulled.body.pull({0.05, 0.0, 0.2}, {0.066, 0.024, kUpper}), 1);
    EXPECT_LT((pulled.centre(cause) - Eigen::Vector3d(0.06, 0.02, kUpper)).norm(), 3e-3);
}

// Between steady and one slow period no derivative leads: a steady load says nothing of its frequency.
TEST(OtherPlaces, ASteadyLoadSaysNothingOfItsFrequency) {
    Body body;
    const Assumption steady{prior_median(*body.mechanics).theta, {body.pull({0.05, 0.02, 0.2}, {0.07, 0.02, 0.04})}};
    Eigen::VectorXd observed;
    ASSERT_TRUE(body.simulator.simulate(steady, observed));
    const Fit fit = fit_jointly(body.simulator, test::white(body.simulator, 1e-4), observed, steady, {});
    ASSERT_TRUE(fit.usable);
    EXPECT_TRUE(fit.says_nothing_of(fit.J.cols() - 1));
}

}  // namespace
}  // namespace teres
