// Fits of one hypothesis, where a body has two equilibria.
#include "plugins/diagnosis/cause_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

Whitener white(const Recording& recording) {
    return Whitener(recording.fit_rows,
                    Eigen::VectorXd::Constant(static_cast<Eigen::Index>(recording.fit_rows.size()), kNoise),
                    Eigen::MatrixXd(recording.observed.size(), 0));
}

const std::vector<double> kSupports{38.0, 70.0};

// A recording of the plate on these supports, with effects on, as a problem whose noise is white.
struct Posed {
    explicit Posed(test::ToyBody& body, const std::vector<EffectInstance>& on = {})
        : effects(body, nullptr, {}),
          observed(body.motion({kSupports, on})),
          recording(*make_recording({"toy", &body, nullptr, observed, kNoise, 1})),
          simulator(body, nullptr, effects),
          problem{simulator, recording, options, {}, white(recording)} {}

    const EffectTable effects;
    const std::vector<double> observed;
    Recording recording;
    Simulator simulator;
    const DiagnosisOptions options{};
    Problem problem;
};

// Found again from its own course: from that of other supports the body ends 50 mm away.
TEST(CauseFit, BeginsWithItsOwnCourse) {
    test::ToyBody body;
    body.other_branch_m = 0.05;
    Posed posed(body);
    Problem& problem = posed.problem;
    const Assumption truth{kSupports, {}}, other{{60.0, 60.0}, {}};
    Eigen::VectorXd trajectory;
    ASSERT_TRUE(posed.simulator.simulate(other, trajectory));
    const double far = static_cast<double>(posed.recording.fit_rows.size()) * 0.05 * 0.05 / (kNoise * kNoise);
    EXPECT_NEAR(problem.fit(truth, 0).misfit, far, 1e-6 * far);
    ASSERT_TRUE(posed.simulator.simulate(other, trajectory));
    EXPECT_LT(fit_from_whole(problem, truth, 0).misfit, 1e-6);
    body.converges = false;
    EXPECT_FALSE(fit_from_whole(problem, truth, 0).usable);
}

// A fit whose steps met another equilibrium than its course does claims to leave nothing: settled, it leaves what its
// course does.
TEST(CauseFit, IsSettledOnItsOwnCourse) {
    test::ToyBody body;
    Posed posed(body);
    Problem& problem = posed.problem;
    problem.floor.noise = static_cast<double>(posed.recording.fit_rows.size());
    Cause cause;
    cause.entries = {posed.effects.find("gravity")};
    const Assumption elsewhere{{45.0, 60.0}, {posed.effects.candidate(cause.entries[0], 0)}};
    const Fit real = fit_from_whole(problem, elsewhere, 0);
    cause.fit = real;
    cause.fit.misfit = 0.1 * real.misfit;
    cause.fit.residual *= std::sqrt(0.1);
    settle(problem, cause, 0);
    EXPECT_NEAR(cause.fit.misfit, real.misfit, 1e-9 * real.misfit);
}

// A residual of 8 in the span of the motion and 2 beside it, floors 1 and 0.1. Come down to 5 it leaves ln (4 + 1)(1 +
// 0.1) where what is beside goes down with the rest, and ln (5 + 1) 0.1 where nothing need be left there.
TEST(CauseFit, IsHopelessByWhatItLeavesInsideAndBesideTheMotion) {
    test::ToyBody body;
    Posed posed(body);
    Problem& problem = posed.problem;
    problem.floor = {.noise = 0.0, .model = 1.0, .noise_beside = 0.0, .model_beside = 0.1};
    const std::size_t channels = 3 * posed.recording.num_markers;
    problem.span = std::make_shared<const MotionSpan>(Eigen::VectorXd::Zero(posed.recording.observed.size()), channels,
                                                      posed.recording.fit_rows);
    const auto rows = static_cast<Eigen::Index>(posed.recording.fit_rows.size());
    Eigen::VectorXd residual = Eigen::VectorXd::Constant(rows, std::sqrt(8.0 / static_cast<double>(rows)));
    residual(0) += 1.0;  // up in the first frame, down in the next
    residual(static_cast<Eigen::Index>(channels)) -= 1.0;
    ASSERT_NEAR(problem.beside_span(residual), 2.0, 1e-12);
    const auto hopeless = [&](double log_above, bool any_course) {
        problem.reach = {.log_above = log_above, .any_course = any_course};
        return problem.hopeless(residual, 5.0);
    };
    EXPECT_TRUE(hopeless(std::log(5.4), false));
    EXPECT_FALSE(hopeless(std::log(5.6), false));
    EXPECT_TRUE(hopeless(std::log(0.59), true));
    EXPECT_FALSE(hopeless(std::log(0.61), true));
    problem.reach = {.misfit = 4.0};
    EXPECT_TRUE(problem.hopeless(residual, 5.0));
    problem.reach = {};
    EXPECT_FALSE(problem.hopeless(residual, 5.0));
}

// Markers that scatter 3.5 times as much as stated (40 draws): with the effect `noise` what is left beside the motion
// is the stated noise. By second differences alone it is off by the scatter of their median.
TEST(CauseFit, NoiseLeavesTheStatedNoiseBesideTheMotion) {
    test::ToyBody body;
    const test::ToyCamera camera;
    const EffectTable effects(body, &camera, {});
    const std::vector<double> observed = body.motion({kSupports, {}});
    Recording recording = *make_recording({"toy", &body, &camera, observed, kNoise, 1});
    Simulator simulator(body, &camera, effects);
    const DiagnosisOptions options{};
    Problem problem{simulator, recording, options, {}, white(recording)};
    const auto rows = static_cast<Eigen::Index>(recording.fit_rows.size());
    problem.span =
        std::make_shared<const MotionSpan>(recording.observed, 3 * recording.num_markers, recording.fit_rows);
    problem.floor = split_floor({.noise = static_cast<double>(rows), .model = 0.35 * static_cast<double>(rows)},
                                problem.span->degrees() / static_cast<double>(rows), options.calibration);
    std::mt19937_64 random(7);
    std::normal_distribution<double> scatter(0.0, 3.5);
    for (int draw = 0; draw < 40; ++draw) {
        Fit fit;
        fit.usable = true;
        fit.at = {kSupports, {{effects.find("noise"), {1.0}}}};
        fit.residual = Eigen::VectorXd::NullaryExpr(rows, [&] { return scatter(random); });
        fit.cost = fit.misfit = fit.residual.squaredNorm();
        take_noise(problem, fit);
        problem.look_beside(fit);
        EXPECT_NEAR(fit.at.effects[0].values[0], 3.5, 0.25);
        EXPECT_NEAR(fit.beside, problem.floor.noise_beside, 1e-6 * problem.floor.noise_beside);
    }
}

// First order asks for eight times the force, with which the body would be in another equilibrium; there the residual
// asks for still more.
TEST(CauseFit, BeginsNoFurtherOffThanWithoutTheEffect) {
    test::ToyBody body;
    body.holds_up_to_n = 1.0;
    const std::vector<double> pull{0.3, 0.3, 0.3, 0.06, 0.05, 3.0};
    Posed posed(body, {{test::ToyBody::kUnknownLoad, pull}});
    Problem& problem = posed.problem;
    const Fit nominal = problem.fit({kSupports, {}}, 0);
    EffectScreening asked;
    asked.entry = posed.effects.find("unknown_load");
    asked.start = {asked.entry, {2.4, 2.4, 2.4, 0.06, 0.05, 3.0}};
    const Cause found = refit(problem, nominal, nullptr, asked, 8);
    ASSERT_TRUE(found.fit.usable);
    EXPECT_LT(found.fit.misfit, 1e-3 * nominal.misfit);
    for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(found.fit.at.effects[0].values[a], 0.3, 0.02);
}

// A modulus ten times too large, and no step to bring it back: with the tilt it starts where that was tried beside it.
TEST(CauseFit, BeginsBesideWhatItWasTriedWith) {
    test::ToyBody body;
    const std::vector<double> soft{0.6}, tilt{0.8, -0.5, 0.6};
    Posed posed(body, {{test::ToyBody::kStiffness, soft}, {test::ToyBody::kGravity, tilt}});
    Cause hiding;
    hiding.entries = {posed.effects.find("stiffness")};
    hiding.fit = posed.problem.fit({kSupports, {{hiding.entries[0], {6.0}}}}, 0);
    const Fit nominal = posed.problem.fit({kSupports, {}}, 0);
    EffectScreening added;
    added.entry = posed.effects.find("gravity");
    added.start = {added.entry, tilt};
    const auto misfit = [&] { return refit(posed.problem, nominal, &hiding, added, 0).fit.misfit; };
    const double as_it_was = misfit();
    added.beside = {{hiding.entries[0], soft}};
    EXPECT_LT(misfit(), 1e-6 * as_it_was);
}

// A tool from 5 s on beside a tilt, found without the tilt as one that acts the other way round until then.
TEST(CauseFit, BesideASteadyLoadAToolMayActTheOtherWayRound) {
    test::ToyBody body;
    body.ends = true;
    const std::vector<double> tilt{0.8, -0.5, 0.6}, tool{0.5, 0.3, -0.4, 0.12, 0.05, 5.0, 24.0};
    Posed posed(body, {{test::ToyBody::kGravity, tilt}, {test::ToyBody::kUnknownLoad, tool}});
    Problem& problem = posed.problem;
    problem.floor.noise = static_cast<double>(posed.recording.fit_rows.size());
    Cause mirrored;
    mirrored.entries = {posed.effects.find("unknown_load")};
    mirrored.fit = problem.fit({kSupports, {{mirrored.entries[0], {-0.5, -0.3, 0.4, 0.12, 0.05, 0.0, 5.0}}}}, 0);
    ASSERT_TRUE(mirrored.fit.usable);
    EffectScreening added;
    added.entry = posed.effects.find("gravity");
    added.start = posed.effects.candidate(added.entry, 0);
    const Fit nominal = problem.fit({kSupports, {}}, 0);
    const Cause both = refit(problem, nominal, &mirrored, added, 8);
    ASSERT_TRUE(both.fit.usable);
    EXPECT_LT(both.fit.misfit, 1e-3 * mirrored.fit.misfit);
    const std::vector<double>& found = both.fit.at.effects[0].values;
    for (std::size_t a = 0; a < 3; ++a) {
        EXPECT_NEAR(found[a], tool[a], 0.02);
        EXPECT_NEAR(both.fit.at.effects[1].values[a], tilt[a], 0.02);
    }
    EXPECT_NEAR(found[5], 5.0, test::kToyDt);
    EXPECT_GT(found[6], posed.simulator.times_s()[posed.recording.first_held_frame - 1]) << "of what is fitted";
}

// Supports five prior deviations away, a bent body, and a known tilt fitted exactly: a refit that begins with likelier
// supports has no time to come back to them, and is made again from the known fit.
class RefitOnTop : public ::testing::Test {
  protected:
    void SetUp() override {
        const std::vector<double> tilt{0.8, -0.5, 0.6};
        const std::vector<double> truth =
            body_.motion({far_, std::vector<EffectInstance>{{test::ToyBody::kGravity, tilt}}});
        std::vector<double> times, observed(truth.size());
        for (std::size_t f = 0; f < body_.num_frames(); ++f) times.push_back(body_.time_s(f));
        const std::vector<double> shift{0.001, -0.002, 0.001};
        camera_.observe(std::vector<EffectInstance>{{test::ToyCamera::kRegistration, shift}}, times, truth, observed);
        recording_.emplace(*make_recording({"toy", &body_, &camera_, observed, kNoise, 1}));
        simulator_.emplace(body_, &camera_, effects_);
        problem_.emplace(Problem{*simulator_, *recording_, options_, {}, white(*recording_)});
        problem_->floor.noise = static_cast<double>(recording_->fit_rows.size());
        nominal_ = problem_->fit({far_, {}}, 0);
        tilted_.entries = {effects_.find("gravity")};
        tilted_.fit = problem_->fit({far_, {{tilted_.entries[0], tilt}}}, 0);
    }
    Cause refitted(const char* id) {
        EffectScreening added;
        added.entry = effects_.find(id);
        added.start = effects_.candidate(added.entry, 0);
        return refit(*problem_, nominal_, &tilted_, added, 1);
    }

    const std::vector<double> far_{50.0 * std::exp(-2.5), 50.0 * std::exp(2.5)};
    test::ToyBody body_;
    test::ToyCamera camera_;
    const EffectTable effects_{body_, &camera_, {}};
    const DiagnosisOptions options_;
    std::optional<Recording> recording_;
    std::optional<Simulator> simulator_;
    std::optional<Problem> problem_;
    Fit nominal_;
    Cause tilted_;
};

TEST_F(RefitOnTop, LeavesNoMoreThanWithoutTheEffect) {
    const Cause shifted = refitted("registration");
    ASSERT_TRUE(shifted.fit.usable);
    EXPECT_LT(shifted.fit.misfit, 0.01 * tilted_.fit.misfit);
    EXPECT_NEAR(shifted.fit.at.effects[1].values[1], -0.002, 1e-4);
}

// What scatters more is where it was: all but the noise stays, to the last digit.
TEST_F(RefitOnTop, NoiseMovesNothing) {
    const Cause noisy = refitted("noise");
    ASSERT_TRUE(noisy.fit.usable);
    EXPECT_EQ(noisy.fit.at.theta, tilted_.fit.at.theta);
    EXPECT_EQ(noisy.fit.at.effects[0].values, tilted_.fit.at.effects[0].values);
    EXPECT_EQ(noisy.fit.trajectory, tilted_.fit.trajectory);
    Cause settled = noisy;
    settle(*problem_, settled, 8);
    EXPECT_EQ(settled.fit.trajectory, tilted_.fit.trajectory);
}

}  // namespace
}  // namespace teres
