// ligament_slack: a part of the ligament is longer or shorter than its rest shape tells.
//
//     shift s        the body's rest place at the ligament moves by -s along the outward normal (a solid band
//     too long
//                    pushes, one too short pulls); strings get longer by s
//     dead zone z    a sheet longer than its gap by z: it holds like strings, which pull when it is drawn straight and
//                    never push
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class LigamentSlack final : public Effect {
  public:
    explicit LigamentSlack(const Scene& scene) {
        d_.id = "ligament_slack";
        d_.kind = "boundary";
        d_.family = "ligament state";
        d_.summary = "a ligament that is slack or stretched in advance";
        d_.source = "assumed: +15 to -12 mm";
        d_.parameters = {amplitude("shift", "m", EffectTransform::kIdentity, 0.0, 0.005, -0.03, 0.03),
                         amplitude("dead_zone", "m", EffectTransform::kIdentity, 0.0, 0.003, 0.0, 0.03)};
        add_centre(d_.parameters, scene);
        d_.parameters.push_back(
            log_shape("radius", "m", 0.15 * scene.size_m, 0.7, 0.02 * scene.size_m, 2.0 * scene.size_m));
        if (scene.tethers.ligament_end == 0) {
            d_.not_applicable = "the case has no ligament (ligament_prior.csv and case.json ligament)";
            return;
        }
        for (const auto& ball : ligament_places(scene, {1.2, 4.8}))
            for (const bool dead : {false, true})
                d_.candidates.push_back({dead ? 0.0 : one_sigma(d_.parameters[0]),
                                         dead ? one_sigma(d_.parameters[1]) : 0.0, ball.centre.x(), ball.centre.y(),
                                         ball.centre.z(), ball.radius_m});
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Eigen::Vector3d centre(v[2], v[3], v[4]);
        for (std::size_t k = 0; k < scene.tethers.ligament_end; ++k) {
            Tether& t = scene.ties()[k];
            const double w = inside(scene.mesh.X.col(t.node), centre, v[5]);
            if (t.kind == Tether::Kind::kBand) {
                t.band.rest -= w * v[0] * t.band.normal;
                t.band.dead_zone_m += w * v[1];
            } else if (t.kind == Tether::Kind::kFan) {
                for (auto& spring : t.fan.near)
                    spring.rest_length_m = std::max(1e-6, spring.rest_length_m + w * (v[0] + v[1]));
            } else {
                t.spring.rest_length = std::max(1e-6, t.spring.rest_length + w * (v[0] + v[1]));
            }
        }
    }
};

}  // namespace

std::unique_ptr<Effect> make_ligament_slack(const Scene& nominal) {
    return std::make_unique<LigamentSlack>(nominal);
}

}  // namespace teres
