// inertia: mass that the model leaves out, e.g. of a hung weight whose pull is known: it is hard to
// accelerate, its weight is not counted again.
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class AddedMass final : public Effect {
  public:
    explicit AddedMass(const Scene& scene) {
        d_.id = "inertia";
        d_.kind = "mechanics";
        d_.family = "inertia";
        d_.summary = "a mass that moves with the body, such as that of a hung weight";
        d_.source = "assumed: up to the body's own mass";
        d_.parameters = {amplitude("mass", "kg", EffectTransform::kIdentity, 0.0, 0.3 * std::max(scene.mass_kg, 1e-6),
                                   0.0, 20.0 * std::max(scene.mass_kg, 1e-6))};
        add_centre(d_.parameters, scene);
        const double typical = 0.08 * scene.size_m;
        d_.parameters.push_back(log_shape("radius", "m", typical, 0.5, 0.01 * scene.size_m, scene.size_m));
        if (!scene.dynamic) {
            d_.not_applicable = "quasi-static recording";
            return;
        }
        const auto add = [&](const Eigen::Vector3d& p, double radius) {
            d_.candidates.push_back({one_sigma(d_.parameters[0]), p.x(), p.y(), p.z(), radius});
        };
        for (const auto& load : scene.parts.loads) {
            Eigen::Vector3d centre = Eigen::Vector3d::Zero();
            double radius = 0.02 * scene.size_m;
            for (std::size_t k = 0; k < load.node.size(); ++k)
                centre += load.weight[k] * scene.mesh.X.col(load.node[k]);
            for (const auto node : load.node) radius = std::max(radius, (scene.mesh.X.col(node) - centre).norm());
            add(centre, radius);
        }
        for (const auto& p : surface_places(scene, 16, true)) add(p, typical);
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Patch& patch = surface_patch(scene, {v[1], v[2], v[3]}, v[4]);
        for (std::size_t k = 0; k < patch.node.size(); ++k) {
            const double mass = v[0] * patch.area_m2[k] / patch.total_m2;
            scene.parts.node_mass_kg(patch.node[k]) += mass;
            scene.force_n.col(patch.node[k]) -= mass * scene.parts.gravity_m_s2;
        }
    }
};

}  // namespace

std::unique_ptr<Effect> make_inertia(const Scene& nominal) {
    return std::make_unique<AddedMass>(nominal);
}

}  // namespace teres
