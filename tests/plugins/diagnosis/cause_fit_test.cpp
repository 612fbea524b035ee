// Fits of one hypothesis, where a body has two equilibria.
#include "plugins/diagnosis/cause_fit.h"

#include <gtest/gtest.h>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

Whitener white(const Recording& recording) {
    return Whitener(recording.fit_rows,
                    Eigen::VectorXd::Constant(static_cast<Eigen::Index>(recording.fit_rows.size()), kNoise),
                    Eigen::MatrixXd(recording.observed.size(), 0));
}

// Found again from its own course: from that of other supports the body ends 50 mm away.
TEST(CauseFit, BeginsWithItsOwnCourse) {
    test::ToyBody body;
    body.other_branch_m = 0.05;
    const EffectTable effects(body, nullptr, {});
    const std::vector<double> observed = body.motion({std::vector<double>{38.0, 70.0}, {}});
    Recording recording = *make_recording({"toy", &body, nullptr, observed, 3e-4, 1});
    Simulator simulator(body, nullptr, effects);
    const DiagnosisOptions options;
    Problem problem{simulator, recording, options, {}, white(recording)};
    const Assumption truth{{38.0, 70.0}, {}}, other{{60.0, 60.0}, {}};
    Eigen::VectorXd trajectory;
    ASSERT_TRUE(simulator.simulate(other, trajectory));
    const double far = static_cast<double>(recording.fit_rows.size()) * 0.05 * 0.05 / (3e-4 * 3e-4);
    EXPECT_NEAR(problem.fit(truth, 0).misfit, far, 1e-6 * far);
    ASSERT_TRUE(simulator.simulate(other, trajectory));
    EXPECT_LT(fit_from_whole(problem, truth, 0).misfit, 1e-6);
    body.converges = false;
    EXPECT_FALSE(fit_from_whole(problem, truth, 0).usable);
}

// First order asks for eight times the force, with which the body would be in another equilibrium; there the residual
// asks for still more.
TEST(CauseFit, BeginsNoFurtherOffThanWithoutTheEffect) {
    test::ToyBody body;
    body.holds_up_to_n = 1.0;
    const std::vector<double> theta{38.0, 70.0}, pull{0.3, 0.3, 0.3, 0.06, 0.05, 3.0};
    const std::vector<EffectInstance> effects_on{{test::ToyBody::kUnknownLoad, pull}};
    const EffectTable effects(body, nullptr, {});
    const std::vector<double> observed = body.motion({theta, effects_on});
    Recording recording = *make_recording({"toy", &body, nullptr, observed, kNoise, 1});
    Simulator simulator(body, nullptr, effects);
    const DiagnosisOptions options;
    Problem problem{simulator, recording, options, {}, white(recording)};
    const Fit nominal = problem.fit({theta, {}}, 0);
    EffectScreening asked;
    asked.entry = effects.find("unknown_load");
    asked.start = {asked.entry, {2.4, 2.4, 2.4, 0.06, 0.05, 3.0}};
    const Cause found = refit(problem, nominal, nullptr, asked, 8);
    ASSERT_TRUE(found.fit.usable);
    EXPECT_LT(found.fit.misfit, 1e-3 * nominal.misfit);
    for (std::size_t a = 0; a < 3; ++a) EXPECT_NEAR(found.fit.at.effects[0].values[a], 0.3, 0.02);
}

}  // namespace
}  // namespace teres
