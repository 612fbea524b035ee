#include "plugins/observation/lift.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace teres {
namespace {

const CameraModel kColor{640, 480, 612.0, 611.0, 322.5, 241.0, {0.02, -0.05, 5e-4, -3e-4, 0.0}};
const CameraModel kDepth{640, 480, 385.0, 385.0, 319.0, 238.5, {}};
constexpr double kUnit = 1e-4;

// Depth image of the plane n·x = d in depth camera axes.
cv::Mat plane_image(const Eigen::Vector3d& n, double d, double disparity_sigma, std::uint32_t seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0.0, disparity_sigma);
    cv::Mat counts(480, 640, CV_16U);
    for (int v = 0; v < 480; ++v)
        for (int u = 0; u < 640; ++u) {
            const Point r = kDepth.ray({double(u), double(v)});
            const double z = d / (n.x() * r[0] + n.y() * r[1] + n.z());
            counts.at<std::uint16_t>(v, u) =
                static_cast<std::uint16_t>(std::lround(1.0 / (1.0 / z + noise(random)) / kUnit));
        }
    return counts;
}

Pose depth_from_color() {
    Pose pose;
    pose.t = {0.015, 0.001, -0.002};
    return pose;
}

// Ray of the colour pixel met with the plane: x = z ray, n·(x + t) = d.
Eigen::Vector3d on_plane(const Pixel& pixel, const Eigen::Vector3d& n, double d) {
    const Point r = kColor.ray(pixel), t = depth_from_color().t;
    const Eigen::Vector3d ray(r[0], r[1], r[2]), shift(t[0], t[1], t[2]);
    return ray * (d - n.dot(shift)) / n.dot(ray);
}

TEST(DepthLift, MeetsATiltedPlaneSeenByAnotherCamera) {
    const Eigen::Vector3d n = Eigen::Vector3d(0.45, -0.25, 1.0).normalized();
    const cv::Mat counts = plane_image(n, 0.28, 0.0, 1);
    const DepthLift lift(counts, kUnit, kDepth, kColor, depth_from_color(), {});
    for (const Pixel& pixel : {Pixel{300.3, 250.7}, Pixel{420.0, 180.5}, Pixel{250.1, 330.0}}) {
        const auto point = lift.at({pixel}, 0.4);
        ASSERT_TRUE(point);
        EXPECT_LT((point->x - on_plane(pixel, n, 0.28)).norm(), 3e-5) << "a third of the depth unit";
    }
}

// White disparity noise (no correlation between pixels): the stated sigma, made for correlated noise, must not be
// below.
TEST(DepthLift, StatedUncertaintyCoversTheError) {
    const Eigen::Vector3d n = Eigen::Vector3d(0.2, 0.1, 1.0).normalized();
    LiftOptions options;
    double squares = 0.0, stated = 0.0;
    int count = 0;
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
        const cv::Mat counts = plane_image(n, 0.3, options.depth_noise_per_m, seed);
        const DepthLift lift(counts, kUnit, kDepth, kColor, depth_from_color(), options);
        for (double u = 220.0; u < 440.0; u += 20.0)
            for (double v = 160.0; v < 320.0; v += 20.0) {
                const auto point = lift.at({{u, v}}, 0.3);
                ASSERT_TRUE(point);
                squares += std::pow(point->x.z() - on_plane({u, v}, n, 0.3).z(), 2);
                stated += point->covariance(2, 2);
                ++count;
            }
    }
    EXPECT_GT(stated / count, squares / count);
    EXPECT_LT(stated / count, 40.0 * squares / count) << "not absurdly wide";
    EXPECT_LT(std::sqrt(squares / count), 0.5 * options.depth_noise_per_m * 0.09) << "below the noise of one pixel";
}

TEST(DepthLift, HolesAndEdgesGiveNothing) {
    const Eigen::Vector3d n(0.0, 0.0, 1.0);
    cv::Mat counts = plane_image(n, 0.3, 0.0, 1);
    const Pixel pixel{322.5, 241.0};
    const auto lifted = [&] {
        return DepthLift(counts, kUnit, kDepth, kColor, depth_from_color(), {}).at({pixel}, 0.3);
    };
    const auto seen = kDepth.project({0.015, 0.001, 0.298});
    const int u = static_cast<int>(seen->u), v = static_cast<int>(seen->v);
    ASSERT_TRUE(lifted());
    for (int i = -20; i <= 20; i += 5)  // flying pixels: a few, anywhere between here and a wall
        counts.at<std::uint16_t>(v + i % 4, u + i / 6) = static_cast<std::uint16_t>(3000 + 100 * (i + 20));
    counts(cv::Rect(u - 4, v - 4, 2, 9)).setTo(0);
    ASSERT_TRUE(lifted());
    EXPECT_NEAR(lifted()->x.z(), 0.302, 2e-4);
    counts(cv::Rect(u - 6, v - 6, 9, 13)).setTo(0);
    EXPECT_FALSE(lifted()) << "most of it is a hole";
    counts.setTo(0);
    EXPECT_FALSE(lifted());
    EXPECT_FALSE(DepthLift(counts, kUnit, kDepth, kColor, depth_from_color(), {}).at({{2.0, 2.0}}, 0.3)) << "outside";
}

TEST(DepthLift, RefusesGrazingViews) {
    for (const auto& [degrees, seen] : {std::pair{60.0, true}, {80.0, false}}) {
        const double a = degrees / 57.29578;
        const Eigen::Vector3d n(std::sin(a), 0.0, std::cos(a));
        const cv::Mat counts = plane_image(n, 0.3 * std::cos(a), 0.0, 1);
        EXPECT_EQ(
            DepthLift(counts, kUnit, kDepth, kColor, depth_from_color(), {}).at({{300.0, 241.0}}, 0.3).has_value(),
            seen)
            << degrees;
    }
}

}  // namespace
}  // namespace teres
