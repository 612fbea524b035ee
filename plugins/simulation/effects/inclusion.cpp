// inclusion: a ball of stiffer or softer tissue, psi' = ratio^w psi, w = 1 inside, 0 outside, smooth edge.
#include <cmath>

#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class Inclusion final : public Effect {
  public:
    explicit Inclusion(const Scene& scene) {
        d_.id = "inclusion";
        d_.kind = "mechanics";
        d_.family = "local stiffness";
        d_.summary = "a region of stiffer or softer tissue";
        d_.source = "HCC 51.5 +- 15, metastasis 49.9 +- 13.8 kPa (x8): 10.1177/8756479317733713";
        d_.parameters = {amplitude("ratio", "1", EffectTransform::kLog, 1.0, 1.0, 0.05, 30.0)};
        add_centre(d_.parameters, scene);
        const double typical = 0.08 * scene.size_m;
        // At most a giant tumour of 12 cm in a liver of 30: a larger region is the tissue's response.
        d_.parameters.push_back(log_shape("radius", "m", typical, 0.5, 0.015 * scene.size_m, 0.2 * scene.size_m));
        for (const auto& place : inner_places(scene, 80))
            for (const double radius : {typical, 1.8 * typical})
                d_.candidates.push_back({one_sigma(d_.parameters[0]), place.x(), place.y(), place.z(), radius});
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const double log_ratio = std::log(v[0]);
        if (log_ratio == 0.0) return;
        const Eigen::Vector3d centre(v[1], v[2], v[3]);
        auto& points = scene.body_points();
        for (std::size_t s = 0; s < points.size(); ++s)
            for (std::size_t q = 0; q < points[s].size(); ++q) {
                const Eigen::Vector3d at = scene.point_centre[s].col(static_cast<Eigen::Index>(q));
                if ((at - centre).squaredNorm() < 4.0 * v[4] * v[4])
                    points[s].stiffness_scale[q] *= std::exp(log_ratio * inside(at, centre, v[4]));
            }
    }
};

}  // namespace

std::unique_ptr<Effect> make_inclusion(const Scene& nominal) {
    return std::make_unique<Inclusion>(nominal);
}

}  // namespace teres
