#include "plugins/observation/sensor_model.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <set>

#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kFrames = 41;
constexpr double kDt = 0.1;

Case seen_case() {
    Case c = test::clamped_block({.frames = static_cast<int>(kFrames), .dt_s = kDt});
    c.sensor.camera_position_m = Point{0.02, 0.01, 0.40};
    c.sensor.view_direction = Point{0.1, 0.05, -1.0};
    c.sensor.up = Point{0.0, 1.0, 0.0};
    return c;
}

std::vector<double> times() {
    std::vector<double> t;
    for (std::size_t f = 0; f < kFrames; ++f) t.push_back(kDt * static_cast<double>(f));
    return t;
}

// Every marker swings about its rest place with its own phase.
std::vector<double> swinging(const Case& c) {
    std::vector<double> x;
    for (const double t : times())
        for (const auto& m : c.markers)
            for (std::size_t a = 0; a < 3; ++a)
                x.push_back(m.position_m[a] + 0.01 * std::sin(2.0 * t + 0.7 * m.id + double(a)));
    return x;
}

std::int32_t index_of(const SensorModel& model, const std::string& id) {
    for (std::size_t e = 0; e < model.num_effects(); ++e)
        if (model.effect(e).id == id) return static_cast<std::int32_t>(e);
    return -1;
}

std::vector<double> seen_with(const SensorModel& model, const std::string& id, const std::vector<double>& values,
                              const std::vector<double>& truth) {
    const std::vector<EffectInstance> on{{index_of(model, id), values}};
    std::vector<double> seen(truth.size());
    model.observe(on, times(), truth, seen);
    return seen;
}

Vector3d at(const std::vector<double>& x, std::size_t frame, std::size_t marker, std::size_t markers) {
    return Eigen::Map<const Vector3d>(&x[3 * (frame * markers + marker)]);
}

TEST(SensorModel, ListsTheSensorIdsOfTheCatalogue) {
    const SensorModel model(seen_case());
    std::set<std::string> ids;
    for (std::size_t e = 0; e < model.num_effects(); ++e) {
        ids.insert(model.effect(e).id);
        EXPECT_STREQ(model.effect(e).kind, "sensor");
        EXPECT_EQ(model.effect(e).not_applicable, nullptr) << model.effect(e).not_applicable;
        EXPECT_GT(model.effect(e).num_candidates, 0) << model.effect(e).id;
    }
    EXPECT_EQ(ids, (std::set<std::string>{"registration", "depth_scale", "latency", "camera_drift", "lens_distortion",
                                          "marker_slip", "noise"}));
}

TEST(SensorModel, NullValuesChangeNothingAndEveryCandidateDoes) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    for (std::size_t e = 0; e < model.num_effects(); ++e) {
        const EffectInfo info = model.effect(e);
        std::vector<double> values(static_cast<std::size_t>(info.num_parameters));
        for (std::int32_t k = 0; k < info.num_candidates; ++k) {
            model.effect_candidate(e, static_cast<std::size_t>(k), values);
            const std::vector<EffectInstance> on{{static_cast<std::int32_t>(e), values}};
            const bool moved = seen_with(model, info.id, values, truth) != truth;
            EXPECT_TRUE(moved || model.noise_factor(on) != 1.0) << info.id << " candidate " << k;
            for (std::size_t p = 0; p < values.size(); ++p) {
                const EffectParameter parameter = model.effect_parameter(e, p);
                EXPECT_GE(values[p], parameter.lower) << info.id << "." << parameter.name;
                EXPECT_LE(values[p], parameter.upper) << info.id << "." << parameter.name;
                if (parameter.role == EffectRole::kAmplitude) values[p] = parameter.null_value;
            }
            const auto nothing = seen_with(model, info.id, values, truth);
            for (std::size_t i = 0; i < truth.size(); ++i) ASSERT_NEAR(nothing[i], truth[i], 1e-15) << info.id;
        }
    }
}

TEST(SensorModel, RegistrationIsTheRigidMotionThatKabschFinds) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    const auto seen = seen_with(model, "registration", {0.003, -0.002, 0.004, 0.02, -0.05, 0.03}, truth);
    const std::size_t M = c.markers.size();
    const Eigen::Map<const Eigen::Matrix3Xd> from(truth.data(), 3, static_cast<Eigen::Index>(M)),
        to(seen.data(), 3, static_cast<Eigen::Index>(M));
    const Eigen::Matrix4d T = Eigen::umeyama(from, to, false);
    EXPECT_NEAR(((T.topLeftCorner<3, 3>() * from).colwise() + T.col(3).head<3>() - to).norm(), 0.0, 1e-12);
    EXPECT_NEAR(Eigen::AngleAxisd(T.topLeftCorner<3, 3>()).angle(), Vector3d(0.02, -0.05, 0.03).norm(), 1e-12);
    Vector3d centre = Vector3d::Zero();  // turns about the markers' centre at rest
    for (const auto& m : c.markers) centre += Vector3d(m.position_m.data()) / double(M);
    EXPECT_NEAR(
        (T.topLeftCorner<3, 3>() * centre + T.col(3).head<3>() - centre - Vector3d(0.003, -0.002, 0.004)).norm(), 0.0,
        1e-12);
}

// A sine seen late is the sine with another phase; Hermite between frames errs by O(dt^3) of a 3 s period.
TEST(SensorModel, LatencyShiftsThePhase) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    const double delay = 0.237, rate = 0.02;
    const auto seen = seen_with(model, "latency", {delay, rate}, truth);
    for (std::size_t f = 8; f < kFrames - 1; ++f)
        for (const auto& m : c.markers)
            for (std::size_t a = 0; a < 3; ++a) {
                const double t = kDt * double(f) * (1.0 - rate) - delay;
                const double want = m.position_m[a] + 0.01 * std::sin(2.0 * t + 0.7 * m.id + double(a));
                EXPECT_NEAR(seen[3 * (f * c.markers.size() + std::size_t(m.id)) + a], want, 2e-6);
            }
}

TEST(SensorModel, DepthIsScaledAlongTheRay) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    const Vector3d o(c.sensor.camera_position_m->data()), view = Vector3d(c.sensor.view_direction->data()).normalized();
    Vector3d centre = Vector3d::Zero();
    for (const auto& m : c.markers) centre += Vector3d(m.position_m.data()) / double(c.markers.size());
    const double z0 = (centre - o).dot(view);
    const auto seen = seen_with(model, "depth_scale", {1.03, 0.005}, truth);
    for (std::size_t m = 0; m < c.markers.size(); ++m) {
        const Vector3d p = at(truth, 5, m, c.markers.size()), q = at(seen, 5, m, c.markers.size());
        const double z = (p - o).dot(view);
        EXPECT_NEAR((q - o).dot(view), 1.03 * z + 0.005 * (z / z0) * (z / z0), 1e-12);
        EXPECT_NEAR((q - o).cross(p - o).norm(), 0.0, 1e-12);
    }
}

TEST(SensorModel, LensMovesPointsRadiallyWithTheCubeOfTheAngle) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    const Vector3d o(c.sensor.camera_position_m->data()), view = Vector3d(c.sensor.view_direction->data()).normalized();
    const auto seen = seen_with(model, "lens_distortion", {0.6}, truth);
    for (std::size_t m = 0; m < c.markers.size(); ++m) {
        const Vector3d p = at(truth, 5, m, c.markers.size()) - o, q = at(seen, 5, m, c.markers.size()) - o;
        const double z = p.dot(view), off = (p - z * view).norm();
        EXPECT_NEAR(q.dot(view), z, 1e-12);
        EXPECT_NEAR((q - z * view).norm() / off, 1.0 + 0.6 * off * off / (z * z), 1e-12);
    }
}

TEST(SensorModel, DriftGrowsLinearly) {
    const Case c = seen_case();
    const SensorModel model(c);
    const auto truth = swinging(c);
    const auto seen = seen_with(model, "camera_drift", {0.004, 0.0, -0.002}, truth);
    for (const std::size_t f : {std::size_t{0}, kFrames / 2, kFrames - 1}) {
        const Vector3d moved = at(seen, f, 3, c.markers.size()) - at(truth, f, 3, c.markers.size());
        EXPECT_NEAR((moved - double(f) / double(kFrames - 1) * Vector3d(0.004, 0.0, -0.002)).norm(), 0.0, 1e-15);
    }
}

TEST(SensorModel, OneMarkerSlipsTwoAreExchanged) {
    const Case c = seen_case();
    const SensorModel model(c);
    const std::size_t M = c.markers.size();
    const auto truth = swinging(c);
    const auto seen = seen_with(model, "marker_slip", {2.0, 5.0, 1.05, 2.05, 0.0, 0.003, 0.0, 1.0}, truth);
    for (std::size_t f = 0; f < kFrames; ++f) {
        const double t = kDt * double(f);
        const bool exchanged = t >= 1.05 && t < 2.05;
        const Vector3d slip(0.0, t >= 1.05 ? 0.003 : 0.0, 0.0);
        EXPECT_NEAR((at(seen, f, 2, M) - at(truth, f, exchanged ? 5 : 2, M) - slip).norm(), 0.0, 1e-15);
        EXPECT_NEAR((at(seen, f, 5, M) - at(truth, f, exchanged ? 2 : 5, M)).norm(), 0.0, 1e-15);
        EXPECT_EQ(at(seen, f, 3, M), at(truth, f, 3, M));
    }
}

TEST(SensorModel, WithoutCameraPoseDepthAndLensSayWhyNot) {
    const SensorModel model(test::clamped_block());
    for (const char* id : {"depth_scale", "lens_distortion"}) {
        const EffectInfo info = model.effect(static_cast<std::size_t>(index_of(model, id)));
        ASSERT_NE(info.not_applicable, nullptr);
        EXPECT_NE(std::string(info.not_applicable).find("camera_position_m"), std::string::npos);
        EXPECT_EQ(info.num_candidates, 0);
    }
}

}  // namespace
}  // namespace teres
