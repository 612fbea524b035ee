// extra_attachment: an adhesion or a ligament that the model does not know: a patch of a band along the
// normal (tether.h), stiffness k per area [N/m^3] (E/h of a band of height h).
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

constexpr double kShearRatio = 0.3;  // of tether.h

class ExtraAttachment final : public Effect {
  public:
    explicit ExtraAttachment(const Scene& scene) {
        d_.id = "extra_attachment";
        d_.kind = "boundary";
        d_.family = "one-sided or extra support";
        d_.summary = "an adhesion or a ligament that the model does not know";
        d_.source = "assumed: 0.25-1.2 N/mm in all; band of 20 mm height and 80 kPa: 4e6 N/m3";
        d_.parameters = {amplitude("stiffness", "N/m3", EffectTransform::kIdentity, 0.0, 2e6, 0.0, 2e8)};
        add_surface_centre(d_, scene);
        const double typical = 0.07 * scene.size_m;
        d_.parameters.push_back(log_shape("radius", "m", typical, 0.5, 0.01 * scene.size_m, 0.4 * scene.size_m));
        for (const auto& p : surface_places(scene, 100, true))
            d_.candidates.push_back({one_sigma(d_.parameters[0]), p.x(), p.y(), p.z(), typical});
        if (d_.candidates.empty()) d_.not_applicable = "the whole surface is attached already";
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Patch& patch = surface_patch(scene, {v[1], v[2], v[3]}, v[4]);
        for (std::size_t k = 0; k < patch.node.size(); ++k) {
            Tether t;
            t.node = patch.node[k];
            t.share = v[0] * patch.area_m2[k];
            t.band = {scene.mesh.X.col(t.node), scene.mesh.node_normal.col(t.node), kShearRatio};
            scene.ties().push_back(t);
        }
    }
};

}  // namespace

std::unique_ptr<Effect> make_extra_attachment(const Scene& nominal) {
    return std::make_unique<ExtraAttachment>(nominal);
}

}  // namespace teres
