// cut: tissue in a region loses its stiffness at some time, psi' = (1 - loss w(x) s(t)) psi; or, with a normal, it is
// parted across a plane: faces within the radius open half way through the duration (parted_body.h). With inertia it
// softens either way.
#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class Cut final : public Effect {
  public:
    explicit Cut(const Scene& scene) {
        d_.id = "cut";
        d_.kind = "mechanics";
        d_.family = "local stiffness";
        d_.summary = "tissue that is parted from some time on";
        d_.source = "assumed";
        d_.event = true;
        const double duration = std::max(scene.end_s - scene.start_s, 1e-3), typical = 0.08 * scene.size_m;
        d_.parameters = {amplitude("loss", "1", EffectTransform::kIdentity, 0.0, 0.6, 0.0, 0.99)};
        add_centre(d_.parameters, scene);
        d_.parameters.push_back(log_shape("radius", "m", typical, 0.5, 0.015 * scene.size_m, 0.2 * scene.size_m));
        // Before it there are frames without it: what is so from the beginning is an inclusion.
        d_.parameters.push_back(shape("onset", "s", scene.start_s + 0.5 * duration, 0.3 * duration,
                                      scene.start_s + 0.05 * duration, scene.end_s));
        d_.parameters.push_back(log_shape("duration", "s", 0.03 * duration, 0.8, 1e-4 * duration, duration));
        for (const char* name : {"normal_x", "normal_y", "normal_z"})
            d_.parameters.push_back(choice(name, "1", 0.0, 1.0, -1.0, 1.0));
        if (!(scene.end_s > scene.start_s)) {
            d_.not_applicable = "the recording has one instant only";
            return;
        }
        for (const auto& p : inner_places(scene, 60))
            for (const double onset : onset_grid(scene, 6))
                d_.candidates.push_back({one_sigma(d_.parameters[0]), p.x(), p.y(), p.z(), 1.3 * typical, onset,
                                         0.03 * duration, 0.0, 0.0, 0.0});
    }
    std::optional<Crack> crack(std::span<const double> v) const override {
        const Eigen::Vector3d normal(v[7], v[8], v[9]);
        if (!(normal.norm() > 0.0)) return {};
        return Crack{{v[1], v[2], v[3]}, normal.normalized(), v[4], v[5] + 0.5 * v[6]};
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const double loss = v[0] * ramp(scene.t_s, v[5], v[6]);
        if (loss == 0.0 || (!scene.dynamic && crack(v))) return;
        const Eigen::Vector3d centre(v[1], v[2], v[3]);
        auto& points = scene.body_points();
        for (std::size_t s = 0; s < points.size(); ++s)
            for (std::size_t q = 0; q < points[s].size(); ++q) {
                const Eigen::Vector3d at = scene.point_centre[s].col(static_cast<Eigen::Index>(q));
                if ((at - centre).squaredNorm() < 4.0 * v[4] * v[4])
                    points[s].stiffness_scale[q] *= 1.0 - loss * inside(at, centre, v[4]);
            }
    }
};

}  // namespace

std::unique_ptr<Effect> make_cut(const Scene& nominal) {
    return std::make_unique<Cut>(nominal);
}

}  // namespace teres
