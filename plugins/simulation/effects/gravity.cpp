// gravity: body force that is missing or tilted, f_i = m_i (g + dg). It is weight, not any force: missing it changes by
// g, and tilted by 60 degrees as well.
#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

constexpr double kStandardGravity = 9.80665;  // m/s^2

class Gravity final : public Effect {
  public:
    explicit Gravity(const Scene& scene) {
        d_.id = "gravity";
        d_.kind = "load";
        d_.family = "steady load";
        d_.summary = "weight that is missing or points elsewhere";
        d_.source = "reverse Trendelenburg 10-30 deg, semi-lateral 30-45 deg: Thiruchelvam 2021, Hepatoma Res 7:22";
        for (const char* name : {"change_x", "change_y", "change_z"})
            d_.parameters.push_back(
                amplitude(name, "m/s2", EffectTransform::kIdentity, 0.0, 1.5, -kStandardGravity, kStandardGravity));
        if (scene.mass_kg > 0.0)
            d_.candidates.push_back(central_candidate(d_.parameters));
        else
            d_.not_applicable = "case.json gives no body.density_kg_m3";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        scene.parts.gravity_m_s2 += Eigen::Vector3d(v[0], v[1], v[2]);
    }
};

}  // namespace

std::unique_ptr<Effect> make_gravity(const Scene& nominal) {
    return std::make_unique<Gravity>(nominal);
}

}  // namespace teres
