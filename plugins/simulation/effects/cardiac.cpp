// cardiac: the beating heart pushes on a patch under the diaphragm. A beat is no sinusoid: its second harmonic has the
// same direction and a share h = a + ib of the first,
//
//     F(t) = Re (C - iS) (e^iwt + h e^2iwt)
#include <cmath>
#include <numbers>

#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

constexpr double kMoved_m = 2e-3;  // one standard deviation
constexpr double kMost = 10.0;     // standard deviations

class Cardiac final : public Effect {
  public:
    explicit Cardiac(const Scene& scene) {
        d_.id = "cardiac";
        d_.kind = "load";
        d_.family = "cardiac";
        d_.summary = "the heart beats against the body";
        d_.source = "heart 10 mm, neighbouring vessels 2-3 mm: arXiv 1405.6747; liver 1-3 mm assumed";
        const double radius = 0.1 * scene.size_m, duration = scene.end_s - scene.start_s;
        // A stiff disk of radius a goes u deep into a half space under 2 E a u / (1 - nu^2) (Boussinesq); u: the middle
        // of the 1 to 3 mm that the liver is moved, where the heart pushes.
        const BodyData& body = scene.data.body;
        const double pushed_n =
            2.0 * body.youngs_modulus_pa * radius * kMoved_m / (1.0 - body.poissons_ratio * body.poissons_ratio);
        for (const char* name : {"cos_x", "cos_y", "cos_z", "sin_x", "sin_y", "sin_z"})
            d_.parameters.push_back(
                amplitude(name, "N", EffectTransform::kIdentity, 0.0, pushed_n, -kMost * pushed_n, kMost * pushed_n));
        add_surface_centre(d_, scene);
        d_.parameters.push_back(log_shape("radius", "m", radius, 0.4, 0.02 * scene.size_m, 0.5 * scene.size_m));
        d_.parameters.push_back(log_shape("frequency", "Hz", 1.2, 0.25, 0.5, 3.0));
        for (const char* name : {"harmonic_cos", "harmonic_sin"})
            d_.parameters.push_back(shape(name, "1", 0.0, 0.3, -1.0, 1.0));
        if (!(duration > 0.0) || !(scene.data.dt_s < 0.5)) {
            d_.not_applicable = "frames are too far apart to see a heart beat";
            return;
        }
        std::vector<double> values = central_candidate(d_.parameters);
        const double step = std::max(0.5 / duration, 0.8 / 16.0);
        for (const auto& p : surface_places(scene, 16, false))
            for (double f = 0.9; f <= 1.7 + 1e-9; f += step) {
                values[6] = p.x();
                values[7] = p.y();
                values[8] = p.z();
                values[10] = f;
                d_.candidates.push_back(values);
            }
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const double phase = 2.0 * std::numbers::pi * v[10] * (scene.t_s - scene.start_s);
        const double c2 = std::cos(2.0 * phase), s2 = std::sin(2.0 * phase);
        const Eigen::Vector3d F = (std::cos(phase) + v[11] * c2 - v[12] * s2) * Eigen::Vector3d(v[0], v[1], v[2]) +
                                  (std::sin(phase) + v[11] * s2 + v[12] * c2) * Eigen::Vector3d(v[3], v[4], v[5]);
        const Patch& patch = surface_patch(scene, {v[6], v[7], v[8]}, v[9]);
        for (std::size_t k = 0; k < patch.node.size(); ++k)
            scene.force_n.col(patch.node[k]) += patch.area_m2[k] / patch.total_m2 * F;
    }
};

}  // namespace

std::unique_ptr<Effect> make_cardiac(const Scene& nominal) {
    return std::make_unique<Cardiac>(nominal);
}

}  // namespace teres
