// viscoelasticity: one Maxwell branch beside the nominal law, which stays the long-term one
// (viscous_memory.h): relaxation G(t) = 1 + g exp(-t/tau) on the second Piola-Kirchhoff stress of the shear
// part.
#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class Viscoelasticity final : public Effect {
  public:
    explicit Viscoelasticity(const Scene& scene) {
        d_.id = "viscoelasticity";
        d_.kind = "mechanics";
        d_.family = "tissue response";
        d_.summary = "tissue that relaxes: stiffer when moved fast";
        d_.source = "g 0.6-1.7, tau 0.5-8 s assumed; nonlinear viscoelastic liver: 10.1007/s10237-020-01297-5";
        d_.parameters = {amplitude("g", "1", EffectTransform::kIdentity, 0.0, 0.8, 0.0, 5.0),
                         log_shape("tau", "s", 2.0, 0.9, 0.02, 60.0)};
        if (!(scene.end_s > scene.start_s)) {
            d_.not_applicable = "the recording has one instant only";
            return;
        }
        for (const double tau : {0.3, 0.7, 1.5, 3.0, 6.0, 12.0})
            d_.candidates.push_back({one_sigma(d_.parameters[0]), tau});
    }
    void apply(std::span<const double> v, Scene& scene) const override { scene.viscosity.push_back({v[0], v[1]}); }
};

}  // namespace

std::unique_ptr<Effect> make_viscoelasticity(const Scene& nominal) {
    return std::make_unique<Viscoelasticity>(nominal);
}

}  // namespace teres
