#include "core/camera/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "core/case/geometry.h"

namespace teres {
namespace {

const CameraModel kCamera{640, 480, 612.0, 609.0, 322.5, 241.0, {0.08, -0.12, 1e-3, -7e-4, 0.03}};

TEST(CameraModel, ProjectsAsOpenCv) {
    const cv::Matx33d K(kCamera.fx_px, 0, kCamera.cx_px, 0, kCamera.fy_px, kCamera.cy_px, 0, 0, 1);
    for (const Point& x : {Point{0.0, 0.0, 0.3}, Point{0.12, -0.08, 0.3}, Point{-0.09, 0.11, 0.4}}) {
        std::vector<cv::Point2d> theirs;
        cv::projectPoints(std::vector<cv::Point3d>{{x[0], x[1], x[2]}}, cv::Vec3d(), cv::Vec3d(), K,
                          std::vector<double>(kCamera.distortion.begin(), kCamera.distortion.end()), theirs);
        const auto ours = kCamera.project(x);
        ASSERT_TRUE(ours);
        EXPECT_NEAR(ours->u, theirs[0].x, 1e-9);
        EXPECT_NEAR(ours->v, theirs[0].y, 1e-9);
    }
}

TEST(CameraModel, RayUndoesProjection) {
    for (double u = 5.0; u < 640.0; u += 90.0)
        for (double v = 5.0; v < 480.0; v += 90.0) {
            const auto back = kCamera.project(kCamera.ray({u, v}));
            ASSERT_TRUE(back);
            EXPECT_NEAR(back->u, u, 1e-6);
            EXPECT_NEAR(back->v, v, 1e-6);
        }
    EXPECT_FALSE(kCamera.project({0.0, 0.0, -0.1}));
}

TEST(CameraModel, LooksAlongTheViewDirection) {
    SensorData sensor;
    EXPECT_FALSE(camera_pose(sensor));
    sensor.camera_position_m = Point{0.0, 0.0, 0.35};
    sensor.view_direction = Point{0.0, 0.0, -1.0};
    sensor.up = Point{0.0, 1.0, 0.0};
    const auto pose = camera_pose(sensor);
    ASSERT_TRUE(pose);
    // 10 cm ahead, 2 cm right, 1 cm down in the image.
    EXPECT_LT(distance(pose->apply({0.02, 0.01, 0.10}), {0.02, -0.01, 0.25}), 1e-12);
    const Point p{0.3, -0.2, 0.1};
    EXPECT_LT(distance((pose->inverse() * *pose).apply(p), p), 1e-12);
    sensor.up = sensor.view_direction;
    EXPECT_FALSE(camera_pose(sensor));
}

TEST(StreamInfo, RefusesWhatIsNoCamera) {
    StreamInfo good;
    good.camera = kCamera;
    ASSERT_TRUE(stream_info(to_message(good)));
    const auto refused = [&](auto&& spoil) {
        camera_info_t m = to_message(good);
        spoil(m);
        return !stream_info(m);
    };
    EXPECT_TRUE(refused([](camera_info_t& m) { m.width_px = 0; }));
    EXPECT_TRUE(refused([](camera_info_t& m) { m.fx_px = -1.0; }));
    EXPECT_TRUE(refused([](camera_info_t& m) { m.cy_px = std::nan(""); }));
    EXPECT_TRUE(refused([](camera_info_t& m) { m.rotation[0] = 0.5; }));
    EXPECT_TRUE(refused([](camera_info_t& m) { m.depth_unit_m = -1e-3; }));
}

}  // namespace
}  // namespace teres
