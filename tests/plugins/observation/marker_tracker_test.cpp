// On films of the phantom: motion of an independent solver, true positions known.
#include "plugins/observation/marker_tracker.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "core/case/case_reader.h"
#include "tools/phantom/depth_sensor.h"
#include "tools/phantom/renderer.h"
#include "tools/phantom/scene.h"

namespace teres {
namespace {

constexpr double kRate = 15.0;

Case demo_case() {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    auto c = read_case(std::string(source != nullptr ? source : ".") + "/config/cases/demo");
    EXPECT_TRUE(c) << c.error().text;
    return *c;
}

struct Film {
    explicit Film(double occlusion)
        : c(demo_case()), scene(*phantom::Scene::make(c, {.occlusion = occlusion})), renderer(scene, {}, 1) {
        to_depth.t = {0.015, 0.0, 0.0};
        for (const MarkerRest& m : c.markers) rest.emplace_back(m.position_m[0], m.position_m[1], m.position_m[2]);
    }
    void shoot(double t) {
        scene.move_to(t);
        renderer.begin_frame();
        counts = sensor.measure(renderer.range(depth, scene.camera() * to_depth.inverse()));
        cv::cvtColor(renderer.color(color, scene.camera()), grey, cv::COLOR_BGR2GRAY);
    }
    Eigen::Vector3d truth(std::size_t i) const {
        const Point x = scene.marker_now(scene.markers()[i]);
        return {x[0], x[1], x[2]};
    }
    Case c;
    phantom::Scene scene;
    phantom::Renderer renderer;
    CameraModel color{640, 480, 612.0, 611.0, 322.5, 241.0, {}}, depth{640, 480, 385.0, 385.0, 319.0, 238.5, {}};
    Pose to_depth;
    phantom::DepthSensor sensor{{}, 385.0, 2};
    std::vector<Eigen::Vector3d> rest;
    cv::Mat grey, counts;
};

TEST(MarkerTracker, KeepsIdentityAndPlaceBehindASweepingRetractor) {
    Film film(0.3);
    MarkerTracker tracker(film.rest, film.color, film.scene.camera(), {});
    std::vector<double> errors;
    int visible = 0, reported_visible = 0;
    for (int k = 0; k < 110; ++k) {  // one sweep there and back
        film.shoot(k / kRate);
        const auto& sights =
            tracker.track(film.grey, DepthLift(film.counts, 1e-4, film.depth, film.color, film.to_depth, {}));
        for (std::size_t i = 0; i < sights.size(); ++i) {
            const bool sees = film.renderer.sees(film.scene.marker_now(film.scene.markers()[i]));
            visible += sees ? 1 : 0;
            if (!sights[i].seen()) continue;
            reported_visible += sees ? 1 : 0;
            errors.push_back((sights[i].x - film.truth(i)).norm());
            // Markers are 25 mm or more apart: within 6 mm it is the right one, and none is invented behind the steel.
            EXPECT_LT(errors.back(), 0.006) << "frame " << k << " marker " << i;
        }
    }
    std::sort(errors.begin(), errors.end());
    const double depth_noise = film.sensor.sigma_m(0.29);
    EXPECT_LT(errors[errors.size() / 2], 2.0 * depth_noise);
    EXPECT_LT(errors[errors.size() * 95 / 100], 4.0 * depth_noise);
    EXPECT_GT(reported_visible, 0.7 * visible);
}

TEST(MarkerTracker, ReportsNothingInAnEmptyPicture) {
    Film film(0.0);
    MarkerTracker tracker(film.rest, film.color, film.scene.camera(), {});
    film.shoot(0.0);
    const cv::Mat empty(film.grey.size(), CV_8U, cv::Scalar(90));
    const DepthLift lift(film.counts, 1e-4, film.depth, film.color, film.to_depth, {});
    for (const MarkerSight& sight : tracker.track(empty, lift)) EXPECT_FALSE(sight.seen());
    int seen = 0;
    for (const MarkerSight& sight : tracker.track(film.grey, lift)) seen += sight.seen() ? 1 : 0;
    EXPECT_GE(seen, 10) << "the first good frame starts the tracks";
    for (const MarkerSight& sight : tracker.track(empty, lift)) EXPECT_FALSE(sight.seen());
}

}  // namespace
}  // namespace teres
