// ligament_tear: a part of the ligament lets go at some time, its stiffness times 1 - loss w(x) s(t). It parts along a
// front: w falls from 1 to 0 within less than two spacings of the surface's nodes.
#include <cmath>

#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

constexpr double kFront = 0.4;  // of the nodes' spacing: w is 0.9 and 0.1 at 2.2 of this before and beyond the front

class LigamentTear final : public Effect {
  public:
    explicit LigamentTear(const Scene& scene) {
        d_.id = "ligament_tear";
        d_.kind = "boundary";
        d_.family = "ligament state";
        d_.summary = "a ligament that lets go at some time";
        d_.source = "assumed";
        d_.event = true;
        const double duration = std::max(scene.end_s - scene.start_s, 1e-3);
        d_.parameters = {amplitude("loss", "1", EffectTransform::kIdentity, 0.0, 0.7, 0.0, 0.999)};
        add_centre(d_.parameters, scene);
        d_.parameters.push_back(
            log_shape("radius", "m", 0.15 * scene.size_m, 0.7, 0.02 * scene.size_m, 2.0 * scene.size_m));
        // Before it there are frames without it: what is so from the beginning is a slack or weaker ligament.
        d_.parameters.push_back(shape("onset", "s", scene.start_s + 0.5 * duration, 0.3 * duration,
                                      scene.start_s + 0.05 * duration, scene.end_s));
        d_.parameters.push_back(log_shape("duration", "s", 0.03 * duration, 0.8, 1e-4 * duration, duration));
        if (scene.tethers.ligament_end == 0) {
            d_.not_applicable = "the case has no ligament (ligament_prior.csv and case.json ligament)";
            return;
        }
        if (!(scene.end_s > scene.start_s)) {
            d_.not_applicable = "the recording has one instant only";
            return;
        }
        for (const auto& ball : ligament_places(scene, {1.2, 2.4, 4.8}))
            for (const double onset : onset_grid(scene, 14))
                d_.candidates.push_back({one_sigma(d_.parameters[0]), ball.centre.x(), ball.centre.y(), ball.centre.z(),
                                         ball.radius_m, onset, 0.03 * duration});
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const double loss = v[0] * ramp(scene.t_s, v[5], v[6]);
        if (loss == 0.0) return;
        const Eigen::Vector3d centre(v[1], v[2], v[3]);
        for (std::size_t k = 0; k < scene.tethers.ligament_end; ++k) {
            Tether& t = scene.ties()[k];
            t.share *= 1.0 - loss * inside(scene.mesh.X.col(t.node), centre, v[4],
                                           kFront * std::sqrt(scene.mesh.node_area[static_cast<std::size_t>(t.node)]));
        }
    }
};

}  // namespace

std::unique_ptr<Effect> make_ligament_tear(const Scene& nominal) {
    return std::make_unique<LigamentTear>(nominal);
}

}  // namespace teres
