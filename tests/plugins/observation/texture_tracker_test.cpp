// A phantom without markers: features of its texture against the material points that they started on.
#include "plugins/observation/texture_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "tools/phantom/depth_sensor.h"
#include "tools/phantom/renderer.h"
#include "tools/phantom/scene.h"

namespace teres {
namespace {

struct Error {
    double t_s, m;
};

double quantile(std::vector<double> values, double q) {
    if (values.empty()) return 1e9;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

std::vector<double> within(const std::vector<Error>& errors, double from_s, double to_s) {
    std::vector<double> out;
    for (const Error& e : errors)
        if (e.t_s >= from_s && e.t_s <= to_s) out.push_back(e.m);
    return out;
}

TEST(TextureTracker, FollowsTheMaterialWithoutDriftAndLosesWhatIsHidden) {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    const auto c = read_case(std::string(source != nullptr ? source : ".") + "/config/cases/demo");
    ASSERT_TRUE(c);
    auto scene = phantom::Scene::make(*c, {.occlusion = 0.3});
    ASSERT_TRUE(scene);
    phantom::Renderer renderer(*scene, {.no_markers = true, .texture = 2.0}, 1);
    const CameraModel color{640, 480, 612.0, 611.0, 322.5, 241.0, {0.02, -0.05, 5e-4, -3e-4, 0.0}},
        depth{640, 480, 385.0, 385.0, 319.0, 238.5, {}};
    Pose depth_to_color;
    depth_to_color.t = {-0.015, 0.0, 0.0};
    const Pose pose = scene->camera();
    phantom::DepthSensor sensor{{}, 385.0, 2};
    const Surface surface(c->mesh);
    TextureTracker tracker(color, pose, {});
    std::vector<phantom::Scene::Marker> truth;
    std::vector<Error> errors;
    constexpr double kRate = 8.0, kSeconds = 7.0;  // the liver goes to its largest load; the retractor sweeps over
    int hidden = 0, hidden_reported = 0, visible = 0, visible_reported = 0;
    for (int k = 0; k <= static_cast<int>(kRate * kSeconds); ++k) {
        const double t = k / kRate;
        scene->move_to(t);
        renderer.begin_frame();
        const cv::Mat counts = sensor.measure(renderer.range(depth, pose * depth_to_color));
        const DepthLift lift(counts, 1e-4, depth, color, depth_to_color.inverse(), {});
        cv::Mat grey;
        cv::cvtColor(renderer.color(color, pose), grey, cv::COLOR_BGR2GRAY);
        if (k == 0) {
            ZBuffer buffer(color.width_px, color.height_px);
            std::vector<ZBuffer::Vertex> vertices;
            ZBuffer::project(c->mesh.nodes, pose.inverse(), color, vertices);
            buffer.draw(vertices, surface.triangles());
            cv::Mat range(color.height_px, color.width_px, CV_32F);
            for (int v = 0; v < range.rows; ++v)
                for (int u = 0; u < range.cols; ++u) range.at<float>(v, u) = buffer.z_m(u, v);
            ASSERT_TRUE(tracker.start(grey, range, lift));
            for (const Feature& f : tracker.features()) {
                const SurfacePoint p = surface.closest({f.rest.x(), f.rest.y(), f.rest.z()});
                EXPECT_LT(p.distance_m, 3e-3);
                truth.push_back({0, p.triangle, p.barycentric, p.position_m});
            }
            continue;
        }
        tracker.track(grey, lift);
        for (std::size_t i = 0; i < truth.size(); ++i) {
            const Point x = scene->marker_now(truth[i]);
            const MarkerSight& sight = tracker.features()[i].sight;
            const bool sees = renderer.sees(x);
            ++(sees ? visible : hidden);
            if (!sight.seen()) continue;
            ++(sees ? visible_reported : hidden_reported);
            errors.push_back({t, distance(x, {sight.x.x(), sight.x.y(), sight.x.z()})});
        }
    }
    const double early = quantile(within(errors, 0.0, 1.0), 0.5),
                 late = quantile(within(errors, kSeconds - 1.0, kSeconds), 0.5);
    const double median = quantile(within(errors, 0.0, kSeconds), 0.5),
                 p95 = quantile(within(errors, 0.0, kSeconds), 0.95);
    std::printf(
        "%zu features, error median %.2f mm, 95th percentile %.2f mm, first second %.2f, last %.2f; visible reported "
        "%.0f %%, hidden reported %d of %d\n",
        truth.size(), 1e3 * median, 1e3 * p95, 1e3 * early, 1e3 * late, 100.0 * visible_reported / visible,
        hidden_reported, hidden);
    EXPECT_GE(truth.size(), 20u);
    EXPECT_LT(median, 6e-4);
    EXPECT_LT(p95, 2.5e-3);
    EXPECT_LT(late, early + 4e-4) << "drift";
    EXPECT_GT(visible_reported, 0.5 * visible);
    EXPECT_LT(hidden_reported, 0.02 * hidden);
}

}  // namespace
}  // namespace teres
