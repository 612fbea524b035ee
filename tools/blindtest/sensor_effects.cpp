#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/case/geometry.h"
#include "tools/blindtest/effect_draws.h"

namespace teres::blindtest {
namespace {

constexpr double kPi = std::numbers::pi;

Point unit(const Point& p) {
    return times(1.0 / norm(p), p);
}

Point rotated(const Point& p, const Point& axis, double angle) {  // Rodrigues
    const double c = std::cos(angle), s = std::sin(angle);
    return plus(plus(times(c, p), times(s, cross(axis, p))), times((1.0 - c) * dot(axis, p), axis));
}

// Catmull-Rom through the frames; outside of the recording the ends hold.
Point at_time(const Frames& frames, std::size_t marker, double frame) {
    const auto last = static_cast<std::ptrdiff_t>(frames.size()) - 1;
    const double clipped = std::clamp(frame, 0.0, static_cast<double>(last));
    const auto k = std::min(static_cast<std::ptrdiff_t>(clipped), last - 1);
    const double u = clipped - static_cast<double>(k);
    const auto p = [&](std::ptrdiff_t i) {
        return frames[static_cast<std::size_t>(std::clamp(i, std::ptrdiff_t{0}, last))][marker];
    };
    const double u2 = u * u, u3 = u2 * u;
    return plus(plus(times(0.5 * (-u3 + 2 * u2 - u), p(k - 1)), times(0.5 * (3 * u3 - 5 * u2 + 2), p(k))),
                plus(times(0.5 * (-3 * u3 + 4 * u2 + u), p(k + 1)), times(0.5 * (u3 - u2), p(k + 2))));
}

template <class Map>
void for_each_position(Frames& frames, const Map& map) {
    for (std::size_t k = 0; k < frames.size(); ++k)
        for (Point& p : frames[k]) p = map(p, k);
}

}  // namespace

EffectTruth draw_sensor(const std::string& id, Random& random, const Case& nominal, SensorState& state) {
    EffectTruth truth;
    truth.id = id;
    auto& parameters = truth.parameters;
    const Point camera = *nominal.sensor.camera_position_m, view = unit(*nominal.sensor.view_direction);
    const double frames = static_cast<double>(state.seen.size()), dt = nominal.dt_s;
    if (id == "registration") {
        const Point shift = times(random.log_uniform(0.001, 0.006), random.direction()), axis = random.direction();
        const double angle = random.log_uniform(0.3, 4.0) * kPi / 180.0;
        for_each_position(state.seen,
                          [&](const Point& p, std::size_t) { return plus(rotated(p, axis, angle), shift); });
        parameters["shift_m"] = shift;
        parameters["axis"] = axis;
        parameters["angle_rad"] = angle;
    } else if (id == "depth_scale") {
        if (random.chance(0.5)) {
            const double scale = 1.0 + random.sign() * random.log_uniform(0.004, 0.035);
            for_each_position(
                state.seen, [&](const Point& p, std::size_t) { return plus(camera, times(scale, minus(p, camera))); });
            parameters["scale"] = scale;
        } else {  // along the ray, grows with depth squared, and waves
            const double bias = random.sign() * random.log_uniform(0.0015, 0.008), depth0 = norm(camera),
                         wave = random.uniform(0.05, 0.12);
            for_each_position(state.seen, [&](const Point& p, std::size_t) {
                const Point ray = minus(p, camera);
                const double z = dot(ray, view);
                return plus(p, times(bias * z * z / (depth0 * depth0) * (1.0 + 0.2 * std::sin(2.0 * kPi * z / wave)),
                                     unit(ray)));
            });
            parameters["bias_m"] = bias;
        }
    } else if (id == "latency") {
        const double latency = random.log_uniform(0.06, 0.5);
        const Frames before = state.seen;
        for (std::size_t k = 0; k < before.size(); ++k)
            for (std::size_t m = 0; m < before[k].size(); ++m)
                state.seen[k][m] = at_time(before, m, static_cast<double>(k) - latency / dt);
        parameters["latency_s"] = latency;
    } else if (id == "camera_drift") {
        const Point drift = times(random.log_uniform(0.0015, 0.007), random.direction()), axis = random.direction();
        const double angle = random.uniform(0.0, 0.8) * kPi / 180.0;
        for_each_position(state.seen, [&](const Point& p, std::size_t k) {
            const double share = std::pow(static_cast<double>(k) / frames, 0.9);
            return plus(plus(camera, rotated(minus(p, camera), axis, share * angle)), times(share, drift));
        });
        parameters["drift_m"] = drift;
    } else if (id == "lens_distortion") {  // metres at 0.1 m off the axis
        const double at_100mm = random.sign() * random.log_uniform(0.0015, 0.006), r0 = 0.1 / norm(camera);
        for_each_position(state.seen, [&](const Point& p, std::size_t) {
            const Point ray = minus(p, camera), side = minus(ray, times(dot(ray, view), view));
            const double r = norm(side) / dot(ray, view) / r0;
            return plus(p, times(at_100mm / 0.1 * r * r * (1.0 - 0.15 * r * r), side));
        });
        parameters["at_100mm_m"] = at_100mm;
    } else if (id == "marker_slip") {
        const std::size_t first = random.index(nominal.markers.size());
        const auto from = static_cast<std::size_t>(random.uniform(0.25, 0.6) * frames);
        truth.onset_s = static_cast<double>(from) * dt;
        truth.markers = {nominal.markers[first].id};
        if (random.chance(0.65)) {
            const Point slip = times(random.log_uniform(0.003, 0.012), random.direction());
            for (std::size_t k = from; k < state.seen.size(); ++k)
                state.seen[k][first] = plus(state.seen[k][first], slip);
            parameters["slip_m"] = slip;
        } else {  // swapped with its neighbour for a while
            std::size_t other = first;
            double near = 1e9;
            for (std::size_t m = 0; m < nominal.markers.size(); ++m) {
                const double gap = distance(nominal.markers[m].position_m, nominal.markers[first].position_m);
                if (m != first && gap < near) near = gap, other = m;
            }
            const auto until =
                std::min(state.seen.size(), from + static_cast<std::size_t>(random.uniform(0.15, 0.35) * frames));
            for (std::size_t k = from; k < until; ++k) std::swap(state.seen[k][first], state.seen[k][other]);
            truth.markers.push_back(nominal.markers[other].id);
            parameters["until_s"] = static_cast<double>(until) * dt;
        }
        truth.center_m = nominal.markers[first].position_m;
        truth.radius_m = 0.005;
    } else {  // noise
        state.noise_factor = random.log_uniform(1.6, 4.0);
        state.depth_step_m = random.chance(0.5) ? 0.0005 : 0.0;
        parameters["factor"] = state.noise_factor;
        parameters["depth_step_m"] = state.depth_step_m;
    }
    return truth;
}

}  // namespace teres::blindtest
