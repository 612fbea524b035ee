#include "plugins/overlay/overlay.h"

#include <gtest/gtest.h>

#include "core/case/geometry.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

// A block of 100 x 30 x 30 mm seen from 0.3 m above its top face; the view is 100 px per 50 mm there.
class DrawnBlock : public ::testing::Test {
  protected:
    DrawnBlock() : c(test::clamped_block()) {
        SensorData sensor;
        sensor.camera_position_m = Point{0.05, 0.015, 0.33};
        sensor.view_direction = Point{0.0, 0.0, -1.0};
        sensor.up = Point{0.0, 1.0, 0.0};
        pose = *camera_pose(sensor);
    }
    cv::Mat drawn(std::vector<StructurePoint> structures, bool stale = false) {
        Overlay overlay(c.mesh, std::move(structures), {});
        overlay.set_camera(camera, pose);
        overlay.set_attachment(nodes, probability);
        if (!moved.empty()) overlay.set_positions(moved);
        cv::Mat frame(240, 320, CV_8UC3, kGrey);
        overlay.draw(frame, stale);
        return frame;
    }
    cv::Vec3b at(const cv::Mat& frame, const Point& x) const {
        const auto p = camera.project(pose.inverse().apply(x));
        return frame.at<cv::Vec3b>(static_cast<int>(std::lround(p->v)), static_cast<int>(std::lround(p->u)));
    }
    const cv::Scalar kGrey{100, 100, 100};
    Case c;
    CameraModel camera{320, 240, 600.0, 600.0, 159.5, 119.5, {}};
    Pose pose;
    std::vector<std::int32_t> nodes;
    std::vector<double> probability;
    std::vector<Point> moved;
};

int change(const cv::Vec3b& pixel) {
    return std::abs(pixel[0] - 100) + std::abs(pixel[1] - 100) + std::abs(pixel[2] - 100);
}

TEST_F(DrawnBlock, CoversTheLiverAndNothingElse) {
    const cv::Mat frame = drawn({});
    EXPECT_GT(change(at(frame, {0.03, 0.014, 0.03})), 5);
    EXPECT_EQ(change(at(frame, {0.03, 0.06, 0.03})), 0);
    for (const Point& x : c.mesh.nodes) moved.push_back(plus(x, {0.0, 0.05, 0.0}));
    const cv::Mat after = drawn({});
    EXPECT_EQ(change(at(after, {0.03, 0.014, 0.03})), 0) << "it went with the nodes";
    EXPECT_GT(change(at(after, {0.03, 0.064, 0.03})), 5);
}

TEST_F(DrawnBlock, AttachmentTurnsRed) {
    for (std::size_t n = 0; n < c.mesh.nodes.size(); ++n)
        if (c.mesh.nodes[n][0] > 0.07) {
            nodes.push_back(static_cast<std::int32_t>(n));
            probability.push_back(1.0);
        }
    const cv::Mat frame = drawn({});
    const cv::Vec3b held = at(frame, {0.092, 0.012, 0.03}), loose = at(frame, {0.022, 0.012, 0.03});
    EXPECT_GT(held[2], held[0] + 80);
    EXPECT_LT(loose[2], loose[0]);
}

// α falls by 1/e for every 40 mm: 20 mm deeper leaves exp(-1/2).
TEST_F(DrawnBlock, DeeperStructuresArePalerAndRideAlong) {
    const Point shallow{0.03, 0.015, 0.025}, deep{0.07, 0.015, 0.005};
    const cv::Mat plain = drawn({}), frame = drawn({{"a", shallow, 0.004}, {"b", deep, 0.004}});
    const Point aside{0.0011, -0.0011, 0.0};  // beside the highlight
    const double near = at(frame, plus(shallow, aside))[0] - at(plain, plus(shallow, aside))[0];
    const double far = at(frame, plus(deep, aside))[0] - at(plain, plus(deep, aside))[0];
    EXPECT_GT(near, 40.0);
    EXPECT_NEAR(far / near, std::exp(-0.5), 0.06);
    for (const Point& x : c.mesh.nodes) moved.push_back(plus(x, {0.0, 0.05, 0.0}));
    const cv::Mat after = drawn({{"a", shallow, 0.004}});
    EXPECT_EQ(change(at(after, shallow)), 0);
}

TEST_F(DrawnBlock, StaleIsWithoutColourAndFramed) {
    const cv::Mat frame = drawn({{"a", {0.03, 0.015, 0.025}, 0.004}}, true);
    const cv::Vec3b inside = at(frame, {0.07, 0.012, 0.03}), border = frame.at<cv::Vec3b>(120, 2);
    EXPECT_NEAR(inside[0], inside[2], 2);
    EXPECT_GT(border[2], border[0] + 100);
}

}  // namespace
}  // namespace teres
