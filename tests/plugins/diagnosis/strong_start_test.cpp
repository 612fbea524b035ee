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

TEST(StrongStart, FramesAreSpreadOverTheRecording) {
    EXPECT_EQ(trial_frames(60), (std::vector<std::int32_t>{5, 11, 17, 23, 29, 35, 41, 47, 53, 59}));
    EXPECT_EQ(trial_frames(4), (std::vector<std::int32_t>{0, 1, 2, 3}));
}

// A plate of modulus 0.55 of the nominal one and starts around it.
struct SoftPlate : Toy {
    const std::vector<double> theta{38.0, 70.0};
    DiagnosisOptions options;
    Recording recording;
    Simulator simulator{body, &camera, effects};
    const std::vector<std::int32_t> frames = trial_frames(test::kToyFrames);

    Assumption at(double scale) const { return {theta, {{effects.find("stiffness"), {scale}}}}; }
    SoftPlate() {
        recording.num_markers = test::kToyMarkers;
        recording.num_frames = test::kToyFrames;
        EXPECT_TRUE(simulator.simulate(at(0.55), recording.observed));
    }
    Problem problem() {
        std::vector<Eigen::Index> rows(static_cast<std::size_t>(recording.observed.size()));
        for (std::size_t k = 0; k < rows.size(); ++k) rows[k] = static_cast<Eigen::Index>(k);
        const Eigen::Index size = recording.observed.size();
        return {simulator,
                recording,
                options,
                {},
                Whitener(rows, Eigen::VectorXd::Constant(size, 1e-3), Eigen::MatrixXd::Zero(size, 0))};
    }
};

TEST(StrongStart, TheBestLeavesTheLeast) {
    SoftPlate plate;
    Problem problem = plate.problem();
    const auto best = best_strong_start(problem, plate.frames, {plate.at(2.0), plate.at(0.6), plate.at(0.2)});
    ASSERT_TRUE(best);
    EXPECT_EQ(best->at.effects[0].values[0], 0.6);
    EXPECT_GT(best->left, 0.0);
    plate.recording.observed(3 * test::kToyMarkers * 5 + 4) = NAN;  // a lost marker counts for nothing
    EXPECT_TRUE(std::isfinite(best_strong_start(problem, plate.frames, {plate.at(0.6)})->left));
    EXPECT_FALSE(best_strong_start(problem, plate.frames, {}));
    plate.body.converges = false;
    EXPECT_FALSE(best_strong_start(problem, plate.frames, {plate.at(0.6)}));
}

TEST(StrongStart, OfManyOnlyTheBestAtAFewFramesAreSimulatedAtAll) {
    SoftPlate plate;
    Problem problem = plate.problem();
    std::vector<Assumption> starts;
    for (int k = 0; k < 12; ++k) starts.push_back(plate.at(0.1 + 0.12 * k));  // 0.58 is next to the truth
    plate.body.simulations = 0;
    const auto best = best_strong_start(problem, plate.frames, starts);
    ASSERT_TRUE(best);
    EXPECT_DOUBLE_EQ(best->at.effects[0].values[0], 0.58);
    EXPECT_EQ(plate.body.simulations, 12 + 4);
    Eigen::VectorXd whole;
    ASSERT_TRUE(plate.simulator.simulate(best->at, whole));
    EXPECT_NEAR(best->left, left_at(problem, plate.frames, whole), 1e-9 * best->left);  // of all frames, not of three
}

TEST(StrongStart, OnlyTheListedFramesCount) {
    SoftPlate plate;
    const Problem problem = plate.problem();
    Eigen::VectorXd trajectory = plate.recording.observed;
    trajectory(3 * test::kToyMarkers * 5 + 1) += 3e-3;  // three standard deviations
    trajectory(3 * test::kToyMarkers * 6 + 1) += 1.0;   // a frame between
    EXPECT_NEAR(left_at(problem, plate.frames, trajectory), 9.0, 1e-9);
}

TEST(StrongStart, TwoModelsSayWhatOneSays) {
    SoftPlate plate, other;
    Problem problem = plate.problem(), beside = other.problem();
    const std::vector<Assumption> starts{plate.at(2.0), plate.at(0.6), plate.at(0.2)};
    const auto alone = best_strong_start(problem, plate.frames, starts);
    problem.beside = &beside;
    other.body.simulations = 0;
    const auto both = best_strong_start(problem, plate.frames, starts);
    ASSERT_TRUE(alone && both);
    EXPECT_EQ(alone->at.effects[0].values, both->at.effects[0].values);
    EXPECT_EQ(alone->left, both->left);
    EXPECT_EQ(other.body.simulations, 1) << "the second of three";
}

}  // namespace
}  // namespace teres
