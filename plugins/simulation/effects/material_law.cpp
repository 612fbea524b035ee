// material_law: tissue that stiffens (or softens) with strain more than the nominal law,
//
//     psi' = psi (1 + beta psi / (2 mu))      psi: nominal shear energy; its stress times (1 + beta psi/mu)
#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class MaterialLaw final : public Effect {
  public:
    explicit MaterialLaw(const Scene&) {
        d_.id = "material_law";
        d_.kind = "mechanics";
        d_.family = "tissue response";
        d_.summary = "tissue that stiffens with strain more than the nominal law";
        d_.source = "Ogden and exponential laws fit 1-50 % strain, StVK does not: 10.1007/s10237-020-01297-5";
        d_.parameters = {amplitude("beta", "1", EffectTransform::kIdentity, 0.0, 4.0, -1.5, 60.0)};
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        for (auto& set : scene.body_points())
            if (set.part.shear != 0.0) set.stiffening += v[0];
    }
};

}  // namespace

std::unique_ptr<Effect> make_material_law(const Scene& nominal) {
    return std::make_unique<MaterialLaw>(nominal);
}

}  // namespace teres
