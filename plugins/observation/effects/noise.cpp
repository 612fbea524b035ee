// noise: the markers scatter more (or less) than stated. Moves nothing; the stated sigma is multiplied.
#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class Noise final : public SensorEffect {
  public:
    explicit Noise(const SensorScene&) {
        d_.id = "noise";
        d_.kind = "sensor";
        d_.family = "noise";
        d_.summary = "markers scatter more than stated";
        d_.source = "z^2 x subpixel / (focal length x baseline): 0.6 mm at 0.4 m, Intel D400 white paper";
        d_.parameters = {amplitude("factor", "1", EffectTransform::kLog, 1.0, 0.7, 0.1, 30.0)};
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void observe(std::span<const double>, Sighting&) const override {}
    double noise_factor(std::span<const double> v) const override { return v[0]; }
};

}  // namespace

std::unique_ptr<SensorEffect> make_noise(const SensorScene& scene) {
    return std::make_unique<Noise>(scene);
}

}  // namespace teres
