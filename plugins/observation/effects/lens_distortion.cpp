// lens_distortion: radial distortion that the calibration left.
//
//     (x', y') = (1 + k1 r^2) (x, y),  r^2 = (x^2 + y^2)/z^2,  z' = z        in camera coordinates
#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class LensDistortion final : public SensorEffect {
  public:
    explicit LensDistortion(const SensorScene& scene) {
        d_.id = "lens_distortion";
        d_.kind = "sensor";
        d_.family = "lens_distortion";
        d_.summary = "radial distortion of the lens";
        d_.source = "assumed: 2-6 mm at 100 mm off axis, seen from 0.35 m";
        d_.parameters = {amplitude("k1", "1", EffectTransform::kIdentity, 0.0, 0.4, -3.0, 3.0)};
        if (!scene.camera) {
            d_.not_applicable = "case.json sensor has no camera pose (camera_position_m, view_direction, up)";
            return;
        }
        camera_ = scene.camera;
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        if (!camera_) return;
        for (Eigen::Index k = 0; k < sighting.position.cols(); ++k) {
            Eigen::Vector3d p = camera_->to_camera(sighting.position.col(k));
            if (!(p.z() > 0.0)) continue;
            p.head<2>() *= 1.0 + v[0] * p.head<2>().squaredNorm() / (p.z() * p.z());
            sighting.position.col(k) = camera_->to_world(p);
        }
    }

  private:
    std::optional<CameraPose> camera_;
};

}  // namespace

std::unique_ptr<SensorEffect> make_lens_distortion(const SensorScene& scene) {
    return std::make_unique<LensDistortion>(scene);
}

}  // namespace teres
