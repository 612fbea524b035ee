#include "plugins/observation/rigid_registration.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cstdlib>

#include "core/case/case_reader.h"
#include "tests/support/synthetic_case.h"
#include "tools/phantom/depth_sensor.h"
#include "tools/phantom/renderer.h"
#include "tools/phantom/scene.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d matrix(const Pose& pose) {
    return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose.R.data());
}
Vector3d vec(const Point& p) {
    return {p[0], p[1], p[2]};
}
// Turned about `center` (case axes) and shifted.
Pose moved(const Pose& pose, const Vector3d& omega, const Vector3d& shift, const Vector3d& center) {
    const Matrix3d D = Eigen::AngleAxisd(omega.norm(), omega.normalized()).toRotationMatrix();
    const Matrix3d R = D * matrix(pose);
    const Vector3d t = D * (vec(pose.t) - center) + center + shift;
    Pose out;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(out.R.data()) = R;
    out.t = {t.x(), t.y(), t.z()};
    return out;
}

// A liver in its frame, with cloth and table around it, seen by a depth camera with noise, holes and flying pixels.
TEST(RigidRegistration, FindsTheCameraFromTheLiversSurfaceAndKnowsHowWell) {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    const auto c = read_case(std::string(source != nullptr ? source : ".") + "/config/cases/demo");
    ASSERT_TRUE(c);
    auto scene = phantom::Scene::make(*c, {.occlusion = 0.0});
    ASSERT_TRUE(scene);
    phantom::Renderer renderer(*scene, {}, 1);
    const CameraModel camera{640, 480, 385.0, 385.0, 319.0, 238.5, {}};
    phantom::DepthSensor sensor{{}, 385.0, 2};
    scene->move_to(0.0);
    renderer.begin_frame();
    const cv::Mat counts = sensor.measure(renderer.range(camera, scene->camera()));
    const auto points = depth_points({counts.ptr<std::uint16_t>(), counts.total()}, camera, 1e-4, 4);
    const Pose truth = scene->camera();
    for (const double sign : {1.0, -1.0}) {
        const Pose start =
            moved(truth, sign * Vector3d(0.05, -0.04, 0.06), sign * Vector3d(0.005, -0.006, 0.004), Vector3d::Zero());
        const auto found = refine_on_surface(c->mesh, points, start, {});
        ASSERT_TRUE(found) << found.error().text;
        // Error as a turn and a shift about the centroid.
        const Matrix3d D = matrix(found->camera_to_case) * matrix(truth).transpose();
        const Eigen::AngleAxisd turn(D);
        Eigen::Matrix<double, 6, 1> error;
        const Vector3d at_centroid = vec(found->camera_to_case.apply(
            truth.inverse().apply({found->centroid.x(), found->centroid.y(), found->centroid.z()})));
        error << turn.angle() * turn.axis(), at_centroid - found->centroid;
        EXPECT_LT(error.head<3>().norm(), 0.01) << "0.6 degrees";
        EXPECT_LT(error.tail<3>().norm(), 1e-3);
        EXPECT_LT(error.dot(found->covariance.ldlt().solve(error)), 25.0) << "99.97 % of a chi square of 6";
        EXPECT_LT(found->rms_m, 1e-3);
    }
}

TEST(RigidRegistration, AFlatFaceLeavesSlidingOpen) {
    const Case c = test::clamped_block();  // 100 x 30 x 30 mm
    std::vector<Point> points;  // of its upper face alone, in the axes of a camera at z = 0.33 that looks down
    for (int i = 1; i < 40; ++i)
        for (int j = 1; j < 12; ++j) points.push_back({0.0025 * i - 0.05, 0.0025 * j - 0.015, 0.3});
    SensorData sensor;
    sensor.camera_position_m = Point{0.05, 0.015, 0.33};
    sensor.view_direction = Point{0.0, 0.0, -1.0};
    sensor.up = Point{0.0, 1.0, 0.0};
    const auto found = refine_on_surface(c.mesh, points, *camera_pose(sensor), {});
    ASSERT_FALSE(found);
    EXPECT_NE(found.error().text.find("leaves the pose open"), std::string::npos) << found.error().text;
    for (Point& p : points) p[2] += 0.1;
    const auto away = refine_on_surface(c.mesh, points, *camera_pose(sensor), {});
    ASSERT_FALSE(away);
    EXPECT_NE(away.error().text.find("0 depth points"), std::string::npos) << away.error().text;
}

TEST(Landmarks, GiveThePoseAndRefuseALine) {
    const Pose truth = moved({}, {0.3, -0.8, 0.4}, {0.1, -0.2, 0.35}, Vector3d::Zero());
    std::vector<Point> camera{{0.0, 0.0, 0.3}, {0.05, 0.01, 0.32}, {-0.02, 0.04, 0.28}, {0.03, -0.05, 0.31}}, model;
    for (const Point& p : camera) model.push_back(truth.apply(p));
    const auto found = align_landmarks(camera, model);
    ASSERT_TRUE(found);
    EXPECT_LT((matrix(*found) - matrix(truth)).norm(), 1e-9);
    EXPECT_LT((vec(found->t) - vec(truth.t)).norm(), 1e-9);
    camera = {{0.0, 0.0, 0.3}, {0.01, 0.0, 0.3}, {0.02, 0.0, 0.3}};
    EXPECT_FALSE(align_landmarks(camera, camera));
    EXPECT_FALSE(align_landmarks(std::span(camera).first(2), std::span(model).first(2)));
}

}  // namespace
}  // namespace teres
