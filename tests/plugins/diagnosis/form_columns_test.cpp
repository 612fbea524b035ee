// What the columns of a cause's form take up and what they leave, on the closed-form body.
#include "plugins/diagnosis/form_columns.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

using test::ToyBody;

// Share of the square of `field` that lies outside of the columns' span.
double outside(const Eigen::MatrixXd& columns, const Eigen::VectorXd& field) {
    const Eigen::VectorXd inside = columns * columns.colPivHouseholderQr().solve(field);
    return (field - inside).squaredNorm() / field.squaredNorm();
}

struct FormColumns : testing::Test {
    ToyBody body;
    test::ToyCamera camera;
    EffectTable effects{body, &camera, {}};
    Simulator simulator{body, &camera, effects};
    const std::vector<double> theta{38.0, 70.0};
    const Eigen::Index channels = static_cast<Eigen::Index>(3 * test::kToyMarkers);
    const Eigen::Index frames = static_cast<Eigen::Index>(test::kToyFrames);

    Eigen::VectorXd trajectory(const Assumption& at) {
        Eigen::VectorXd out;
        simulator.simulate(at, out);
        return out;
    }
};

TEST_F(FormColumns, TakeUpABentALaggingAndAFadingCourse) {
    const Assumption plain{theta, {}}, soft{theta, {{effects.find("stiffness"), {0.5}}}};
    const Eigen::VectorXd without = trajectory(plain), with = trajectory(soft), a = with - without;
    const Eigen::MatrixXd columns = form_columns(simulator, soft, with, 0.2);
    ASSERT_GE(columns.cols(), 6);
    for (Eigen::Index c = 0; c < columns.cols(); ++c)
        EXPECT_LE(columns.col(c).norm(), 0.2 * a.norm() * (1.0 + 1e-9)) << c;

    const Eigen::MatrixXd field = a.reshaped(channels, frames);
    Eigen::MatrixXd fading = field;  // half as large at the end
    for (Eigen::Index f = 0; f < frames; ++f)
        fading.col(f) *= 0.75 + 0.25 * std::cos(M_PI * static_cast<double>(f) / static_cast<double>(frames - 1));
    EXPECT_LT(outside(columns, fading.reshaped()), 1e-9);
    const Assumption softer{theta, {{effects.find("stiffness"), {0.4}}}};
    EXPECT_LT(outside(columns, trajectory(softer) - without), 1e-9) << "the same form, larger";
}

TEST_F(FormColumns, LeaveAnotherCause) {
    const Assumption soft{theta, {{effects.find("stiffness"), {0.5}}}};
    const Eigen::MatrixXd columns = form_columns(simulator, soft, trajectory(soft), 0.2);
    const Assumption tilted{theta, {{effects.find("gravity"), {0.4, -0.4, 0.4}}}};
    EXPECT_GT(outside(columns, trajectory(tilted) - trajectory({theta, {}})), 0.5);
}

TEST_F(FormColumns, SensorsHaveTheFormTheyHave) {
    const Assumption shifted{theta, {{effects.find("registration"), {0.004, -0.003, 0.005}}}};
    EXPECT_EQ(form_columns(simulator, shifted, trajectory(shifted), 0.2).cols(), 0);
}

}  // namespace
}  // namespace teres
