// unknown_load: something else pulls or pushes on a patch of the surface for a while, steadily or
// periodically.
//
//     F(t) = F w(t) (steady, f below a quarter of a period) or F w(t) sin^2(pi f (t - onset));
//
// w rises at onset, falls at end.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

constexpr double kLeastPeriods = 0.25, kLeastHz = 0.01;

class UnknownLoad final : public Effect {
  public:
    explicit UnknownLoad(const Scene& scene) {
        d_.id = "unknown_load";
        d_.kind = "load";
        d_.family = "unknown_load";
        d_.summary = "another tool pulls or pushes on the surface";
        d_.source = "assumed: 0.1-1.2 N";
        d_.event = true;
        for (const char* name : {"force_x", "force_y", "force_z"})
            d_.parameters.push_back(amplitude(name, "N", EffectTransform::kIdentity, 0.0, 0.3, -5.0, 5.0));
        add_surface_centre(d_, scene);
        const double t0 = scene.start_s, t1 = scene.end_s, duration = std::max(t1 - t0, 1e-3),
                     radius = 0.05 * scene.size_m;
        d_.parameters.push_back(log_shape("radius", "m", radius, 0.4, 0.01 * scene.size_m, 0.3 * scene.size_m));
        d_.parameters.push_back(shape("onset", "s", t0 + 0.3 * duration, 0.5 * duration, t0 - duration, t1));
        d_.parameters.push_back(shape("end", "s", t1, duration, t0, t1 + 2.0 * duration));
        d_.parameters.push_back(log_shape("rise", "s", 0.05 * duration, 0.8, 1e-4 * duration, duration));
        d_.parameters.push_back(shape("frequency", "Hz", 0.0, 0.3, 0.0, 3.0));
        least_hz_ = std::max(kLeastPeriods / duration, kLeastHz);
        const double f = one_sigma(d_.parameters[0]), never = t1 + duration, rise = 0.05 * duration;
        for (const auto& p : surface_places(scene, 60, false)) {
            const auto add = [&](double onset, double end, double frequency) {
                d_.candidates.push_back({f, f, f, p.x(), p.y(), p.z(), radius, onset, end, rise, frequency});
            };
            add(t0 - duration, never, 0.0);
            for (const double share : {0.25, 0.5, 0.75}) add(t0 + share * duration, never, 0.0);
            for (const double share : {0.0, 0.33, 0.66})
                add(t0 + share * duration, t0 + (share + 0.33) * duration, 0.0);
            for (const double share : {0.0, 0.2, 0.4, 0.6})
                for (const double periods : {1.5, 2.5, 4.0})
                    add(t0 + share * duration, never, std::min(periods / duration, 3.0));
        }
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        double w = ramp(scene.t_s, v[7], v[9]) * (1.0 - ramp(scene.t_s, v[8], v[9]));
        if (v[10] >= least_hz_) {
            const double s = std::sin(std::numbers::pi * v[10] * (scene.t_s - v[7]));
            w *= s * s;
        }
        if (w == 0.0) return;
        const Patch& patch = surface_patch(scene, {v[3], v[4], v[5]}, v[6]);
        for (std::size_t k = 0; k < patch.node.size(); ++k)
            scene.force_n.col(patch.node[k]) +=
                w * patch.area_m2[k] / patch.total_m2 * Eigen::Vector3d(v[0], v[1], v[2]);
    }

  private:
    // Slower is steady: between F and F sin^2(0) no derivative leads, and a fit that takes one stops where it is.
    double least_hz_ = 0.0;
};

}  // namespace

std::unique_ptr<Effect> make_unknown_load(const Scene& nominal) {
    return std::make_unique<UnknownLoad>(nominal);
}

}  // namespace teres
