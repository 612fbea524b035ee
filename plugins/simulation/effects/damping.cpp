// damping: Rayleigh damping that is missing or wrong. Mass part r_M M v; stiffness part as Kelvin-Voigt
// stress r_K dS_e/dt (viscous_memory.h), which rigid rotation leaves alone.
#include <algorithm>

#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class Damping final : public Effect {
  public:
    explicit Damping(const Scene& scene) {
        d_.id = "damping";
        d_.kind = "mechanics";
        d_.family = "damping";
        d_.summary = "motion that dies out faster or slower";
        d_.source = "assumed: up to 10 % of critical at 3 Hz";  // r_M = 2 zeta w, r_K = 2 zeta / w
        const double rM = scene.data.body.rayleigh_mass_1_s, rK = scene.data.body.rayleigh_stiffness_s;
        d_.parameters = {amplitude("mass_rate", "1/s", EffectTransform::kIdentity, rM, 4.0, 0.0, 100.0),
                         amplitude("stiffness_time", "s", EffectTransform::kIdentity, rK, 0.01, 0.0, 0.2)};
        if (scene.dynamic)
            d_.candidates.push_back(central_candidate(d_.parameters));
        else
            d_.not_applicable = "quasi-static recording";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        scene.rayleigh_mass_1_s = v[0];
        std::erase_if(scene.viscosity, [](const ViscousBranch& b) { return b.time_constant_s == 0.0; });
        if (v[1] > 0.0) scene.viscosity.push_back({v[1], 0.0});
    }
};

}  // namespace

std::unique_ptr<Effect> make_damping(const Scene& nominal) {
    return std::make_unique<Damping>(nominal);
}

}  // namespace teres
