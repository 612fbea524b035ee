// depth_scale: the depth camera measures too long or too short.
//
//     p' = o + (s + a z / z0^2) (p - o),     o the camera, z the depth of p, z0 that of the markers' centre:
//     a depth z is read as s z + a (z/z0)^2 along its ray
#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class DepthScale final : public SensorEffect {
  public:
    explicit DepthScale(const SensorScene& scene) {
        d_.id = "depth_scale";
        d_.kind = "sensor";
        d_.family = "sensor offset";
        d_.summary = "scale or bias of the measured depth";
        d_.source = "D435 reads 981 mm at 1 m: Calvert 2018; bias grows with depth squared: Intel D400 white paper";
        d_.parameters = {amplitude("scale", "1", EffectTransform::kLog, 1.0, 0.02, 0.8, 1.25),
                         amplitude("bias", "m", EffectTransform::kIdentity, 0.0, 0.004, -0.04, 0.04)};
        if (!scene.camera) {
            d_.not_applicable = "case.json sensor has no camera pose (camera_position_m, view_direction, up)";
            return;
        }
        camera_ = *scene.camera;
        reference_depth_ = camera_.to_camera(scene.centre).z();
        if (!(reference_depth_ > 0.0)) {
            d_.not_applicable = "the markers are not in front of the camera";
            return;
        }
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        if (!(reference_depth_ > 0.0)) return;
        for (Eigen::Index k = 0; k < sighting.position.cols(); ++k) {
            const Eigen::Vector3d p = camera_.to_camera(sighting.position.col(k));
            const double factor = v[0] + v[1] * p.z() / (reference_depth_ * reference_depth_);
            sighting.position.col(k) = camera_.position + factor * (sighting.position.col(k) - camera_.position);
        }
    }

  private:
    CameraPose camera_;
    double reference_depth_ = 0.0;  // z0 [m]
};

}  // namespace

std::unique_ptr<SensorEffect> make_depth_scale(const SensorScene& scene) {
    return std::make_unique<DepthScale>(scene);
}

}  // namespace teres
