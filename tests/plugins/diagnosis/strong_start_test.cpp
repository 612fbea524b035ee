// Starts at full size, by hand, and the best of them by its simulation.
#include "plugins/diagnosis/strong_start.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <numeric>
#include <set>

#include "plugins/diagnosis/cause_fit.h"
#include "plugins/simulation/trajectory.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/toy_body.h"
#include "tests/support/white.h"

namespace teres {
namespace {

using test::ToyBody;

struct Toy {
    ToyBody body;
    test::ToyCamera camera;
    EffectTable effects{body, &camera, {}};
};

// Every marker at every frame, with this standard deviation.
Problem compared_by(Simulator& simulator, Recording& recording, const DiagnosisOptions& options, double sigma_m) {
    std::vector<Eigen::Index> rows(static_cast<std::size_t>(recording.observed.size()));
    std::iota(rows.begin(), rows.end(), Eigen::Index{0});
    const Eigen::Index size = recording.observed.size();
    return {simulator,
            recording,
            options,
            {},
            Whitener(rows, Eigen::VectorXd::Constant(size, sigma_m), Eigen::MatrixXd::Zero(size, 0))};
}

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
    Problem problem() { return compared_by(simulator, recording, options, 1e-3); }
};

TEST(StrongStart, TheBestLeavesTheLeast) {
    SoftPlate plate;
    Problem problem = plate.problem();
    const auto best = best_strong_starts(problem, plate.frames, {plate.at(2.0), plate.at(0.6), plate.at(0.2)});
    ASSERT_EQ(best.size(), 1u);
    EXPECT_EQ(best[0].at.effects[0].values[0], 0.6);
    EXPECT_GT(best[0].left, 0.0);
    plate.recording.observed(3 * test::kToyMarkers * 5 + 4) = NAN;  // a lost marker counts for nothing
    EXPECT_TRUE(std::isfinite(best_strong_starts(problem, plate.frames, {plate.at(0.6)}).at(0).left));
    EXPECT_TRUE(best_strong_starts(problem, plate.frames, {}).empty());
    plate.body.converges = false;
    EXPECT_TRUE(best_strong_starts(problem, plate.frames, {plate.at(0.6)}).empty());
}

TEST(StrongStart, OfManyOnlyTheBestAtAFewFramesAreSimulatedAtAll) {
    SoftPlate plate;
    Problem problem = plate.problem();
    std::vector<Assumption> starts;
    for (int k = 0; k < 12; ++k) starts.push_back(plate.at(0.1 + 0.12 * k));  // 0.58 is next to the truth
    plate.body.simulations = 0;
    const auto best = best_strong_starts(problem, plate.frames, starts);
    ASSERT_EQ(best.size(), 1u);
    EXPECT_DOUBLE_EQ(best[0].at.effects[0].values[0], 0.58);
    EXPECT_EQ(plate.body.simulations, 12 + 4);
    Eigen::VectorXd whole;
    ASSERT_TRUE(plate.simulator.simulate(best[0].at, whole));
    EXPECT_NEAR(best[0].left, left_at(problem, plate.frames, whole),
                1e-9 * best[0].left);  // of all frames, not of three
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
    const auto alone = best_strong_starts(problem, plate.frames, starts);
    problem.beside = &beside;
    other.body.simulations = 0;
    const auto both = best_strong_starts(problem, plate.frames, starts);
    ASSERT_TRUE(alone.size() == 1 && both.size() == 1);
    EXPECT_EQ(alone[0].at.effects[0].values, both[0].at.effects[0].values);
    EXPECT_EQ(alone[0].left, both[0].left);
    EXPECT_EQ(other.body.simulations, 1) << "the second of three";
}

TEST(StrongStart, WorkWithinSharedWorkStaysWithItsModel) {
    SoftPlate plate, other;
    Problem problem = plate.problem(), beside = other.problem();
    problem.beside = &beside;
    std::array<std::array<const Problem*, 2>, 2> outer{}, inner{};
    side_by_side(problem, 2, [&](Problem& p, std::size_t k) {
        side_by_side(p, 2, [&](Problem& q, std::size_t j) {
            outer[k][j] = &p;
            inner[k][j] = &q;
        });
    });
    EXPECT_EQ(outer[0][0], &problem);
    EXPECT_EQ(outer[1][0], &beside);
    EXPECT_EQ(inner, outer) << "the other thread is taken";
    EXPECT_EQ(problem.beside, &beside);
}

// A tool that takes hold between frames 36 and 37, [7.2, 7.4] s, of a body whose load takes 0.1 s to rise.
struct SuddenLoad {
    ToyBody body;
    test::ToyCamera camera;
    EffectTable effects;
    DiagnosisOptions options;
    Recording recording;
    Simulator simulator;

    static ToyBody sudden() {
        ToyBody body;
        body.sudden = true;
        return body;
    }
    Assumption at(double onset_s, double duration_s) const {
        return {{38.0, 70.0}, {{effects.find("unknown_load"), {0.5, 0.2, -0.4, 0.06, 0.05, onset_s, duration_s}}}};
    }
    SuddenLoad() : body(sudden()), effects(body, &camera, {}), simulator(body, &camera, effects) {
        recording.num_markers = test::kToyMarkers;
        recording.num_frames = recording.first_held_frame = test::kToyFrames;
        EXPECT_TRUE(simulator.simulate(at(7.25, 0.1), recording.observed));
    }
    Problem problem() { return compared_by(simulator, recording, options, 1e-4); }
};

TEST(StrongStart, AnEventIsPutBetweenTheFramesWhereItHappens) {
    SuddenLoad tool;
    Problem problem = tool.problem();
    const auto from = [&](const Assumption& fitted) {
        Eigen::VectorXd trajectory;
        EXPECT_TRUE(tool.simulator.simulate(fitted, trajectory));
        return at_best_instant(problem, fitted, trajectory);
    };
    const auto moved = from(tool.at(2.3, 1.5));
    ASSERT_TRUE(moved);
    const std::vector<double>& values = moved->at.effects[0].values;
    EXPECT_NEAR(values[5] + 0.5 * values[6], 7.3, 1e-12);
    EXPECT_NEAR(values[6], 1.5, 1e-12);
    EXPECT_LT(moved->left, 1e-12);
    const auto later = from(tool.at(10.3, 0.5));  // the frames before it serve as they are, those after it others
    ASSERT_TRUE(later);
    EXPECT_NEAR(later->at.effects[0].values[5] + 0.25, 7.3, 1e-12);
    EXPECT_LT(later->left, 1e-12);
    const std::vector<double> shorter = from(tool.at(2.3, 0.01))->at.effects[0].values;
    EXPECT_NEAR(shorter[5], 7.2, 1e-12);
    EXPECT_NEAR(shorter[6], 0.2, 1e-12) << "from frame to frame at least";
    EXPECT_FALSE(from({{38.0, 70.0}, {{tool.effects.find("stiffness"), {0.8}}}}));
    Assumption filmed = tool.at(2.3, 1.5);
    filmed.effects.insert(filmed.effects.begin(), tool.effects.candidate(tool.effects.find("registration"), 0));
    EXPECT_FALSE(from(filmed)) << "frames alone do not show what the camera does";
    tool.body.inertia = true;
    EXPECT_FALSE(from(tool.at(2.3, 1.5))) << "with inertia a frame depends on those before";
}

// Descent alone leaves an event far from its instant where it is.
TEST(StrongStart, AFitFindsItsInstant) {
    SuddenLoad tool;
    Problem problem = tool.problem();
    Assumption start = tool.at(2.3, 0.3);
    start.effects[0].values[0] = 0.4;
    Fit fit = fit_from_whole(problem, start, 12);
    ASSERT_TRUE(fit.usable);
    EXPECT_GT(std::abs(fit.at.effects[0].values[5] - 7.2), 1.0);
    settle_instant(problem, fit, 12);
    EXPECT_GT(fit.at.effects[0].values[5], 7.15);
    EXPECT_LT(fit.at.effects[0].values[5] + fit.at.effects[0].values[6], 7.45);
    EXPECT_NEAR(fit.at.effects[0].values[0], 0.5, 0.01);
    // No derivative tells where between the frames it is: it is not drawn to its prior at 6 s.
    const Fit again = problem.fit(fit.at, 12);
    EXPECT_NEAR(again.at.effects[0].values[5], fit.at.effects[0].values[5], 0.05);
}

TEST(StrongStart, AllExtentsOfAnEventAreTriedAtOneInstant) {
    SuddenLoad tool;
    EffectScreening load;
    load.entry = tool.effects.find("unknown_load");
    load.places.push_back({{0.0, 0.0, 0.0}, 0.0, 0.0, tool.effects.candidate(load.entry, 0), 0});
    const auto starts = strong_starts(tool.effects, load, {});
    EXPECT_EQ(starts.size(), 2u * 9u);  // sizes, places; four instants
    Problem problem = tool.problem();
    std::vector<Assumption> at;
    for (const double force : {0.1, 0.5, 2.0}) {
        at.push_back(tool.at(0.0, 0.5));
        at.back().effects[0].values[0] = force;
    }
    const auto best = best_strong_starts(problem, trial_frames(test::kToyFrames), at);
    ASSERT_EQ(best.size(), 3u);
    EXPECT_EQ(best[0].at.effects[0].values[0], 0.5);
    EXPECT_NEAR(best[0].at.effects[0].values[5] + 0.25, 7.3, 1e-12);
}

// A block that lies on ligaments at both ends, pulled sideways; the one at its far end lets go between two frames.
struct TornBlock {
    static Case block() {
        Case c = test::clamped_block({.size_m = {0.10, 0.04, 0.04},
                                      .cells = {8, 3, 3},
                                      .law = BodyLaw::kNeoHookean,
                                      .youngs_modulus_pa = 15e3,
                                      .frames = 30,
                                      .dt_s = 0.2,
                                      .full_force_n = {0.02, 0.1, -0.1}});
        c.ligament = LigamentData{LigamentLaw::kNeoHookean, 20e3, 0.45, 0.02, 0.04, 0.0};
        for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
            if (const double x = c.mesh.nodes[i][0]; x == 0.0 || x == 0.10)
                c.ligament_prior.push_back({static_cast<std::int32_t>(i), 0.7});
        c.clamped.clear();
        return c;
    }
    std::unique_ptr<Trajectory> mechanics = *Trajectory::make(block(), {});
    EffectTable effects{*mechanics, nullptr, {}};
    Simulator simulator{*mechanics, nullptr, effects};
    DiagnosisOptions options;
    Recording recording;
    EffectScreening tear;

    Assumption torn() const {
        return {prior_median(*mechanics).theta, {{tear.entry, {0.95, 0.10, 0.02, 0.02, 0.03, 3.05, 0.1}}}};
    }
    TornBlock() {
        tear.entry = effects.find("ligament_tear");
        const ActiveEffect first = effects.candidate(tear.entry, 0);
        tear.start = first;
        tear.start.values[0] = 0.02;  // what first order asks for: next to nothing
        tear.places.push_back({{first.values[1], first.values[2], first.values[3]}, 0.0, 0.0, tear.start, 0});
        recording.num_markers = mechanics->num_markers();
        recording.num_frames = recording.first_held_frame = mechanics->num_frames();
        EXPECT_TRUE(simulator.simulate(torn(), recording.observed));
    }
};

TEST(StrongStart, ATearBeginsWithAllThatCanBeLost) {
    const TornBlock block;
    const auto starts = strong_starts(block.effects, block.tear, block.torn().theta);
    std::set<std::array<double, 4>> balls;
    for (const Assumption& start : starts) {
        const std::vector<double>& v = start.effects[0].values;
        EXPECT_EQ(v[0], 0.999) << "several times a candidate's loss";
        balls.insert({v[1], v[2], v[3], v[4]});
    }
    EXPECT_EQ(starts.size(), balls.size()) << "each place and extent once";
    EXPECT_GE(starts.size(), 4u);
}

TEST(StrongStart, ATornLigamentIsFittedFromWhereItIsTorn) {
    TornBlock block;
    Problem problem{block.simulator, block.recording, block.options, {}, test::white(block.simulator, 3e-4)};
    const Fit nominal = problem.fit(prior_median(*block.mechanics), 8);
    const Cause cause = refit_torn(problem, nominal, block.tear, 8);
    ASSERT_TRUE(cause.fit.usable);
    EXPECT_EQ(cause.entries, std::vector<std::size_t>{block.tear.entry});
    EXPECT_LT(cause.fit.misfit, 0.01 * nominal.misfit);
    const std::vector<double>& found = cause.fit.at.effects[0].values;
    EXPECT_NEAR(found[5] + 0.5 * found[6], 3.1, 0.1) << "in the gap between two frames";
    EXPECT_NEAR(found[1], 0.10, 0.02);
    EXPECT_GT(found[0], 0.8);
}

}  // namespace
}  // namespace teres
