// A sensor effect: what the camera makes of true marker positions that the nominal sensor (none of it) leaves
// out. One file per effect in this folder; CMakeLists.txt lists them, the catalogue is made from that list.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/effect_description.h"

namespace teres {

/// Where the camera stands, in the case's frame. Columns of axes: right, down, view.
struct CameraPose {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();

    Eigen::Vector3d to_camera(const Eigen::Vector3d& p) const { return axes.transpose() * (p - position); }
    Eigen::Vector3d to_world(const Eigen::Vector3d& p) const { return position + axes * p; }
};

/// What a sensor effect may know of the case when it is made.
struct SensorScene {
    std::optional<CameraPose> camera;
    std::vector<Eigen::Vector3d> marker;               ///< at rest [m]
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< of the markers at rest
    double start_s = 0.0, end_s = 0.0;                 ///< of the recording
    double dt_s = 0.0;
};

/// Marker trajectories as seen so far: marker m of frame f at f * M + m.
struct Sighting {
    std::span<const double> time_s;
    std::size_t num_markers;
    Eigen::Map<Eigen::Matrix3Xd> position;

    Eigen::Index column(std::size_t frame, std::size_t marker) const {
        return static_cast<Eigen::Index>(frame * num_markers + marker);
    }
};

class SensorEffect {
  public:
    virtual ~SensorEffect() = default;
    const EffectDescription& description() const { return d_; }

    /// Changes the sighting as the effect with these physical values would.
    virtual void observe(std::span<const double> values, Sighting& sighting) const = 0;
    /// Factor on the stated noise.
    virtual double noise_factor(std::span<const double>) const { return 1.0; }

  protected:
    EffectDescription d_;
};

/// All sensor effects of the catalogue, in the order in which they act on a ray of light.
std::vector<std::unique_ptr<SensorEffect>> make_sensor_effects(const SensorScene& scene);

}  // namespace teres
