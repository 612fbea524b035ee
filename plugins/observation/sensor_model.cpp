#include "plugins/observation/sensor_model.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "core/case/frame_times.h"
#include "core/check.h"

namespace teres {

namespace {

Eigen::Vector3d as_vector(const Point& p) {
    return {p[0], p[1], p[2]};
}

std::optional<CameraPose> camera_pose(const SensorData& sensor) {
    if (!sensor.camera_position_m || !sensor.view_direction || !sensor.up) return {};
    CameraPose pose;
    pose.position = as_vector(*sensor.camera_position_m);
    const Eigen::Vector3d view = as_vector(*sensor.view_direction).normalized();
    const Eigen::Vector3d right = view.cross(as_vector(*sensor.up)).normalized();
    pose.axes << right, view.cross(right), view;
    if (!pose.axes.allFinite() || right.norm() < 0.5) return {};
    return pose;
}

SensorScene scene_of(const Case& c) {
    SensorScene scene;
    scene.camera = camera_pose(c.sensor);
    for (const auto& marker : c.markers) {
        scene.marker.push_back(as_vector(marker.position_m));
        scene.centre += scene.marker.back() / static_cast<double>(c.markers.size());
    }
    const std::vector<double> times = frame_times(c);
    if (!times.empty()) {
        scene.start_s = times.front();
        scene.end_s = times.back();
    }
    scene.dt_s = c.dt_s;
    return scene;
}

}  // namespace

SensorModel::SensorModel(const Case& c) : effects_(make_sensor_effects(scene_of(c))) {}

void SensorModel::effect_candidate(std::size_t effect, std::size_t candidate, std::span<double> values) const noexcept {
    const auto& from = effects_[effect]->description().candidates[candidate];
    TERES_CHECK(values.size() == from.size());
    std::copy(from.begin(), from.end(), values.begin());
}

void SensorModel::observe(std::span<const EffectInstance> effects, std::span<const double> time_s,
                          std::span<const double> truth, std::span<double> observed) const noexcept {
    TERES_CHECK(truth.size() == observed.size() && !time_s.empty() && truth.size() % (3 * time_s.size()) == 0);
    std::copy(truth.begin(), truth.end(), observed.begin());
    Sighting sighting{time_s, truth.size() / 3 / time_s.size(),
                      Eigen::Map<Eigen::Matrix3Xd>(observed.data(), 3, static_cast<Eigen::Index>(truth.size() / 3))};
    for (std::size_t e = 0; e < effects_.size(); ++e)
        for (const auto& instance : effects)
            if (static_cast<std::size_t>(instance.index) == e) effects_[e]->observe(instance.values, sighting);
}

double SensorModel::noise_factor(std::span<const EffectInstance> effects) const noexcept {
    double factor = 1.0;
    for (const auto& instance : effects)
        factor *= effects_[static_cast<std::size_t>(instance.index)]->noise_factor(instance.values);
    return factor;
}

}  // namespace teres
