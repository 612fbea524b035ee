// Fits of one hypothesis, where a body has two equilibria.
#include "plugins/diagnosis/cause_fit.h"

#include <gtest/gtest.h>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

// Found again from its own course: from that of other supports the body ends 50 mm away.
TEST(CauseFit, BeginsWithItsOwnCourse) {
    test::ToyBody body;
    body.other_branch_m = 0.05;
    const EffectTable effects(body, nullptr, {});
    const std::vector<double> observed = body.motion({std::vector<double>{38.0, 70.0}, {}});
    Recording recording = *make_recording({"toy", &body, nullptr, observed, 3e-4, 1});
    Simulator simulator(body, nullptr, effects);
    const DiagnosisOptions options;
    Problem problem{simulator,
                    recording,
                    options,
                    {},
                    Whitener(recording.fit_rows,
                             Eigen::VectorXd::Constant(static_cast<Eigen::Index>(recording.fit_rows.size()), 3e-4),
                             Eigen::MatrixXd(recording.observed.size(), 0))};
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

}  // namespace
}  // namespace teres
