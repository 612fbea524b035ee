// load_scale: a known load is mis-measured in size or direction, f' = R(turn) (1 + gain) f.
#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "plugins/simulation/effects/effect.h"

namespace teres {
namespace {

class LoadScale final : public Effect {
  public:
    explicit LoadScale(const Scene& scene) {
        d_.id = "load_scale";
        d_.kind = "load";
        d_.family = "load_scale";
        d_.summary = "a known load whose size or direction is mis-measured";
        d_.source = "gain 25-60 %, direction 10 % assumed";
        const double last = static_cast<double>(scene.parts.loads.size()) - 1.0;
        d_.parameters = {amplitude("gain", "1", EffectTransform::kIdentity, 0.0, 0.35, -1.0, 4.0)};
        for (const char* name : {"turn_x", "turn_y", "turn_z"})
            d_.parameters.push_back(amplitude(name, "rad", EffectTransform::kIdentity, 0.0, 0.15, -1.6, 1.6));
        d_.parameters.push_back(choice("region", "1", -1.0, 1.0, -1.0, std::max(last, -1.0)));  // -1: all
        std::set<std::int32_t> loaded;
        for (const auto& sample : scene.data.loads)
            if (sample.force_n != Point{}) loaded.insert(sample.region);
        if (loaded.empty()) {
            d_.not_applicable = "no known load acts (loads.csv)";
            return;
        }
        std::vector<double> values = central_candidate(d_.parameters);
        if (loaded.size() > 1) d_.candidates.push_back(values);
        for (const auto region : loaded) {
            values.back() = region;
            d_.candidates.push_back(values);
        }
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const Eigen::Vector3d turn(v[1], v[2], v[3]);
        const double angle = turn.norm(), region = std::round(v[4]);
        Eigen::Matrix3d R = (1.0 + v[0]) * Eigen::Matrix3d::Identity();
        if (angle > 0.0) R *= Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
        for (std::size_t r = 0; 3 * r < scene.region_force_n.size(); ++r)
            if (region < 0.0 || region == static_cast<double>(r)) {
                Eigen::Map<Eigen::Vector3d> f(&scene.region_force_n[3 * r]);
                f = (R * f).eval();
            }
    }
};

}  // namespace

std::unique_ptr<Effect> make_load_scale(const Scene& nominal) {
    return std::make_unique<LoadScale>(nominal);
}

}  // namespace teres
