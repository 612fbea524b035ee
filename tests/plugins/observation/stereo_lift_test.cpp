#include "plugins/observation/stereo_lift.h"

#include <gtest/gtest.h>

namespace teres {
namespace {

const StereoPair kPair{{640, 480, 385.0, 385.0, 319.0, 238.5, {}},
                       {640, 480, 390.0, 390.0, 322.0, 240.0, {0.02, -0.05, 5e-4, -3e-4, 0.0}},
                       {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.05, 0.001, -0.002}}};
constexpr double kArea = 60.0;

Blob left_dot(const Point& x) {
    return {*kPair.left.project(x), kArea};
}
std::vector<Blob> right_dots(const std::vector<Point>& points) {
    std::vector<Blob> dots;
    for (const Point& x : points) dots.push_back({*kPair.right.project(kPair.right_to_left.inverse().apply(x)), kArea});
    return dots;
}
StereoLift lift(const std::vector<Blob>& dots) {
    return {kPair, dots, LiftOptions{}, MeetingOptions{}};
}

TEST(StereoLift, FindsTheSameDotInTheOtherImage) {
    const std::vector<Point> points{{0.01, 0.02, 0.30}, {0.04, -0.01, 0.28}, {-0.05, 0.02, 0.32}};
    const std::vector<Blob> right = right_dots(points);
    for (const Point& x : points) {
        const auto found = lift(right).at(left_dot(x), x[2] + 0.01);
        ASSERT_TRUE(found);
        EXPECT_LT((found->x - Eigen::Vector3d(x[0], x[1], x[2])).norm(), 1e-7);
    }
    EXPECT_FALSE(lift(right).at(left_dot({0.0, -0.06, 0.3}), 0.3)) << "no dot on that row";
}

// Disparity noise of σ √2 px at z gives z² σ √2 / (f B) of depth.
TEST(StereoLift, StatesTheUncertaintyOfItsDisparity) {
    const Point x{0.01, 0.02, 0.30};
    std::vector<Blob> right = right_dots({x});
    const auto exact = lift(right).at(left_dot(x), 0.3);
    const double sigma_px = LiftOptions{}.pixel_sigma;
    right[0].center.u += sigma_px * std::sqrt(2.0);
    const auto off = lift(right).at(left_dot(x), 0.3);
    ASSERT_TRUE(exact && off);
    EXPECT_NEAR(std::abs(off->x.z() - exact->x.z()) / std::sqrt(exact->covariance(2, 2)), 1.0, 0.05);
}

TEST(StereoLift, RefusesWhatItCannotTellApart) {
    const Point x{0.01, 0.02, 0.30}, y{0.01 * 0.31 / 0.30, 0.02 * 0.31 / 0.30, 0.31};  // the same pixel on the left
    EXPECT_FALSE(lift(right_dots({x, y})).at(left_dot(x), 0.305)) << "halfway between both";
    const auto found = lift(right_dots({x, y})).at(left_dot(x), 0.302);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->x.z(), 0.30, 1e-4);
}

TEST(StereoLift, RefusesADotThatOneCameraSeesInPart) {
    const Point x{0.01, 0.02, 0.30};
    std::vector<Blob> right = right_dots({x});
    right[0].area_px = 0.6 * kArea;
    EXPECT_FALSE(lift(right).at(left_dot(x), 0.3));
    EXPECT_TRUE(lift(right_dots({x})).at(left_dot(x), 0.3));
}

TEST(StereoLift, RefusesRaysThatPassEachOther) {
    const Point x{0.01, 0.02, 0.30};
    std::vector<Blob> right = right_dots({x});
    right[0].center.v += 2.0;  // 1.6 mm at 0.3 m
    EXPECT_FALSE(lift(right).at(left_dot(x), 0.3));
}

}  // namespace
}  // namespace teres
