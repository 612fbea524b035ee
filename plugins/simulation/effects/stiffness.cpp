// stiffness: the whole body is stiffer or softer, psi' = factor psi.
#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class Stiffness final : public Effect {
  public:
    explicit Stiffness(const Scene&) {
        d_.id = "stiffness";
        d_.kind = "mechanics";
        d_.family = "tissue response";
        d_.summary = "the whole body is stiffer or softer";
        d_.source = "6.6 +- 1.7 kPa: 10.1177/8756479317733713; x5 when pressurised: PMC3359872";
        d_.parameters = {amplitude("factor", "1", EffectTransform::kLog, 1.0, 0.5, 0.1, 10.0)};
        d_.candidates.push_back(central_candidate(d_.parameters));
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        for (auto& set : scene.body_points())
            for (auto& s : set.stiffness_scale) s *= v[0];
    }
};

}  // namespace

std::unique_ptr<Effect> make_stiffness(const Scene& nominal) {
    return std::make_unique<Stiffness>(nominal);
}

}  // namespace teres
