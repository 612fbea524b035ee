// clamp_compliance: a support held rigid gives way, as if a layer of the body's own tissue of this thickness
// lay between: stiffness per area E/(h0 + h), h0 the thin layer that stands for a rigid clamp. One side of it may be
// thicker than the other,
//
//     h(X) = layer exp(tilt . (X - Xm)/L)     Xm middle of the clamped nodes, L size of the body
#include <cmath>

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
        for (const char* name : {"tilt_x", "tilt_y", "tilt_z"})
            d_.parameters.push_back(shape(name, "1", 0.0, 3.0, -12.0, 12.0));
        const std::size_t begin = scene.tethers.clamp_begin, end = scene.tethers.clamp_end;
        if (end == begin) {
            d_.not_applicable = "nothing is held rigidly (clamped.csv)";
            return;
        }
        d_.candidates.push_back(central_candidate(d_.parameters));
        for (std::size_t k = begin; k < end; ++k)
            middle_ += scene.mesh.X.col(scene.parts.tethers[k].node) / static_cast<double>(end - begin);
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Eigen::Vector3d tilt = Eigen::Vector3d(v[1], v[2], v[3]) / scene.size_m;
        for (std::size_t k = scene.tethers.clamp_begin; k < scene.tethers.clamp_end; ++k) {
            Tether& t = scene.ties()[k];
            const double layer = v[0] * std::exp(tilt.dot(scene.mesh.X.col(t.node) - middle_));
            t.share *= scene.clamp_layer_m / (scene.clamp_layer_m + layer);
        }
    }

  private:
    Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();  // Xm
};

}  // namespace

std::unique_ptr<Effect> make_clamp_compliance(const Scene& nominal) {
    return std::make_unique<ClampCompliance>(nominal);
}

}  // namespace teres
