// clamp_compliance: a support held rigid gives way, as if a layer of the body's own tissue of this thickness
// lay between: stiffness per area E/(h0 + h), h0 the thin layer that stands for a rigid clamp.
#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class ClampCompliance final : public Effect {
  public:
    explicit ClampCompliance(const Scene& scene) {
        d_.id = "clamp_compliance";
        d_.kind = "boundary";
        d_.family = "clamp_compliance";
        d_.summary = "a support held rigid that gives way";
        d_.source = "vein 0.62+-0.41 MPa, capsule 8.2+-3.4 MPa: Umale 2011; layer thickness assumed";
        d_.parameters = {
            amplitude("layer", "m", EffectTransform::kIdentity, 0.0, 0.1 * scene.size_m, 0.0, scene.size_m)};
        if (scene.tethers.clamp_end > scene.tethers.clamp_begin)
            d_.candidates.push_back(central_candidate(d_.parameters));
        else
            d_.not_applicable = "nothing is held rigidly (clamped.csv)";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        for (std::size_t k = scene.tethers.clamp_begin; k < scene.tethers.clamp_end; ++k)
            scene.ties()[k].share *= scene.clamp_layer_m / (scene.clamp_layer_m + v[0]);
    }
};

}  // namespace

std::unique_ptr<Effect> make_clamp_compliance(const Scene& nominal) {
    return std::make_unique<ClampCompliance>(nominal);
}

}  // namespace teres
