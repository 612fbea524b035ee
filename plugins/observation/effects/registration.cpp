// registration: the camera's frame is off by a rigid motion.
//
//     p' = c + R(w) (p - c) + t,     c the markers' centre at rest, w rotation vector
#include <Eigen/Geometry>

#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class Registration final : public SensorEffect {
  public:
    explicit Registration(const SensorScene& scene) : centre_(scene.centre) {
        d_.id = "registration";
        d_.kind = "sensor";
        d_.family = "sensor offset";
        d_.summary = "rigid offset between camera and model";
        d_.source = "rigid target error 3.8-7.7 mm: Heiselman 2024, J. Med. Imaging 11(1) 015001";
        for (const char* name : {"shift_x", "shift_y", "shift_z"})
            d_.parameters.push_back(amplitude(name, "m", EffectTransform::kIdentity, 0.0, 0.003, -0.05, 0.05));
        for (const char* name : {"turn_x", "turn_y", "turn_z"})
            d_.parameters.push_back(amplitude(name, "rad", EffectTransform::kIdentity, 0.0, 0.025, -0.5, 0.5));
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        const Eigen::Vector3d shift(v[0], v[1], v[2]), turn(v[3], v[4], v[5]);
        const double angle = turn.norm();
        const Eigen::Matrix3d R =
            angle > 0.0 ? Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix() : Eigen::Matrix3d::Identity();
        sighting.position = (R * (sighting.position.colwise() - centre_)).colwise() + (centre_ + shift);
    }

  private:
    Eigen::Vector3d centre_;
};

}  // namespace

std::unique_ptr<SensorEffect> make_registration(const SensorScene& scene) {
    return std::make_unique<Registration>(scene);
}

}  // namespace teres
