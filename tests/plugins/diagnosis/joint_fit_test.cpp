// Fits on a body in closed form, against the values that made the data.
#include "plugins/diagnosis/joint_fit.h"

#include <gtest/gtest.h>

#include "tests/support/toy_body.h"
#include "tests/support/white.h"

namespace teres {
namespace {

struct Toy {
    test::ToyBody body;
    test::ToyCamera camera;
    EffectTable effects{body, &camera, {}};
    Simulator simulator{body, &camera, effects};

    Assumption with_slip(double x_m, double y_m, double z_m, double marker, double onset_s) const {
        return {{40.0, 60.0}, {{effects.find("marker_slip"), {x_m, y_m, z_m, marker, onset_s}}}};
    }
};

// Marker 0 and the onset lie half a standard deviation from their priors' centres, where no derivative holds them.
TEST(JointFit, AChoiceStaysWhereTheSearchPutIt) {
    Toy toy;
    Eigen::VectorXd observed;
    ASSERT_TRUE(toy.simulator.simulate(toy.with_slip(0.008, -0.003, 0.002, 0.0, 1.5), observed));
    const Fit fit = fit_jointly(toy.simulator, test::white(toy.simulator, 3e-4), observed,
                                toy.with_slip(0.004, 0.0, 0.0, 0.0, 1.5), {});
    ASSERT_TRUE(fit.usable);
    const std::vector<double>& values = fit.at.effects[0].values;
    EXPECT_NEAR(values[0], 0.008, 1e-4);
    EXPECT_NEAR(values[1], -0.003, 1e-4);
    EXPECT_NEAR(values[2], 0.002, 1e-4);
    EXPECT_EQ(values[3], 0.0);
    EXPECT_EQ(values[4], 1.5);
    EXPECT_EQ(fit.J.rightCols<2>().norm(), 0.0);
    EXPECT_EQ(fit.u.tail<2>().norm(), 0.0) << "a choice costs nothing: its search has been paid for";
}

}  // namespace
}  // namespace teres
