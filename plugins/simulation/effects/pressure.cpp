// pressure: net pressure on one side of the surface (pneumoperitoneum), steady plus a slow change. It follows
// the deformed surface:
//
//     p(t) = pressure + slope (t - t0)/(t1 - t0) on faces whose rest normal N looks along d: share of the
//     face clamp(N.d / 0.3, 0, 1); d = 0: all round
#include <algorithm>

#include <Eigen/Geometry>

#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class Pressure final : public Effect {
  public:
    explicit Pressure(const Scene& scene) {
        d_.id = "pressure";
        d_.kind = "load";
        d_.family = "steady load";
        d_.summary = "pressure on one side, as of a pneumoperitoneum";
        d_.source = "12 mmHg in all (s00464-025-12392-y); net part 0.03-0.12 kPa assumed";
        d_.parameters = {amplitude("pressure", "Pa", EffectTransform::kIdentity, 0.0, 60.0, -3000.0, 3000.0),
                         amplitude("slope", "Pa", EffectTransform::kIdentity, 0.0, 30.0, -3000.0, 3000.0)};
        for (const char* name : {"toward_x", "toward_y", "toward_z"})
            d_.parameters.push_back(shape(name, "1", 0.0, 0.6, -1.0, 1.0));
        const auto add = [&](const Eigen::Vector3d& d) {
            d_.candidates.push_back({one_sigma(d_.parameters[0]), one_sigma(d_.parameters[1]), d.x(), d.y(), d.z()});
        };
        if (scene.data.sensor.view_direction) {
            const Point& view = *scene.data.sensor.view_direction;
            add(-Eigen::Vector3d(view[0], view[1], view[2]).normalized());
        }
        for (int axis = 0; axis < 3; ++axis)
            for (const double sign : {1.0, -1.0}) add(sign * Eigen::Vector3d::Unit(axis));
        add(Eigen::Vector3d::Zero());
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const double duration = scene.end_s - scene.start_s;
        const double p = v[0] + (duration > 0.0 ? v[1] * (scene.t_s - scene.start_s) / duration : 0.0);
        const Eigen::Vector3d d(v[2], v[3], v[4]);
        const double length = d.norm();
        for (std::size_t t = 0; t < scene.mesh.surface.size(); ++t) {
            const auto at = [&](std::size_t i) { return Eigen::Vector3d(scene.mesh.X.col(scene.mesh.surface[t][i])); };
            const Eigen::Vector3d N = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
            const double share = length > 1e-3 ? std::clamp(N.dot(d) / length / 0.3, 0.0, 1.0) : 1.0;
            scene.pressure_pa(static_cast<Eigen::Index>(t)) += share * p;
        }
    }
};

}  // namespace

std::unique_ptr<Effect> make_pressure(const Scene& nominal) {
    return std::make_unique<Pressure>(nominal);
}

}  // namespace teres
