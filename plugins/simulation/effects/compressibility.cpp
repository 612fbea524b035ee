// compressibility: another Poisson's ratio at the same shear modulus; the volume part of the energy is scaled
// by
//
//     lambda'/lambda = [nu'/(1 - 2 nu')] / [nu/(1 - 2 nu)]        Ogden: K'/K = [(1 + nu')/(1 - 2 nu')] /
//     [...]
#include <algorithm>

#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

double volume_modulus(const Material& material, double nu) {
    return (material.law() == BodyLaw::kOgden ? (1.0 + nu) / 3.0 : nu) * 2.0 * material.mu() / (1.0 - 2.0 * nu);
}

double poissons_ratio(const Material& material) {
    const double mu = material.mu(), modulus = material.lambda();
    return material.law() == BodyLaw::kOgden ? (3.0 * modulus - 2.0 * mu) / (2.0 * (3.0 * modulus + mu))
                                             : modulus / (2.0 * (modulus + mu));
}

class Compressibility final : public Effect {
  public:
    explicit Compressibility(const Scene& scene) {
        d_.id = "compressibility";
        d_.kind = "mechanics";
        d_.family = "compressibility";
        d_.summary = "tissue that changes its volume more or less easily";
        d_.source = "0.45-0.5 usual; gross errors to 0.2 assumed";
        const double nu = std::clamp(poissons_ratio(scene.parts.body.material()), 0.05, 0.4995);
        d_.parameters = {amplitude("poissons_ratio", "1", EffectTransform::kIdentity, nu, 0.06, 0.02, 0.4999)};
        d_.candidates.push_back({std::max(0.05, nu - 0.06)});
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Material& material = scene.parts.body.material();
        const double factor = volume_modulus(material, v[0]) / material.lambda();
        for (auto& set : scene.body_points())
            if (set.part.shear == 0.0)
                for (auto& s : set.stiffness_scale) s *= factor;
    }
};

}  // namespace

std::unique_ptr<Effect> make_compressibility(const Scene& nominal) {
    return std::make_unique<Compressibility>(nominal);
}

}  // namespace teres
