// Frames that stand for all, against pen and paper.
#include "plugins/simulation/frame_choice.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST(FrameChoice, BothSidesOfAJumpAreSolved) {
    MatrixXd z = MatrixXd::Zero(1, 20);
    z.rightCols(9).setConstant(1.0);  // jumps between frames 10 and 11
    EXPECT_EQ(frames_to_solve(z, 4), (std::vector<std::int32_t>{0, 10, 11, 19}));
}

TEST(FrameChoice, DistinctShapesAreChosenAndOthersTakeTheNearest) {
    std::vector<VectorXd> x;
    for (const double v : {0.0, 0.1, 5.0, 5.1, 9.0}) x.push_back(VectorXd::Constant(1, v));
    std::vector<std::size_t> nearest;
    EXPECT_EQ(distinct_frames(x, {}, 3, nearest), (std::vector<std::size_t>{0, 4, 2}));
    EXPECT_EQ(nearest, (std::vector<std::size_t>{0, 0, 2, 2, 1}));
    EXPECT_EQ(distinct_frames(x, {}, 9, nearest).size(), 5u);
    EXPECT_EQ(distinct_frames(x, {1, 3}, 9, nearest), (std::vector<std::size_t>{1, 3}));
    EXPECT_EQ(nearest, (std::vector<std::size_t>{0, 0, 1, 1, 1}));
}

// First order that falls short by a fixed share, and by a rest that is linear in time, is made whole exactly.
TEST(FrameChoice, RestOfFirstOrderIsFilledIn) {
    const std::vector<std::int32_t> frames{0, 3, 7, 9};
    MatrixXd dz(2, 10), rest(2, 4), linear(2, 10);
    for (int f = 0; f < 10; ++f) {
        dz.col(f) << std::sin(1.0 + f), std::cos(1.0 + f);
        linear.col(f) << 0.2 * f, -0.1 * f;
    }
    for (int k = 0; k < 4; ++k) rest.col(k) = -0.3 * dz.col(frames[static_cast<std::size_t>(k)]);
    EXPECT_LT((with_rest(dz, rest, frames) - 0.7 * dz).norm(), 1e-5);
    for (int k = 0; k < 4; ++k) rest.col(k) = linear.col(frames[static_cast<std::size_t>(k)]);
    EXPECT_LT((with_rest(MatrixXd::Zero(2, 10), rest, frames) - linear).norm(), 1e-12);
}

}  // namespace
}  // namespace teres
