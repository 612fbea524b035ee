// latency: stamps are late, or the camera's clock runs at another rate.
//
//     p'(t) = p(t - tau - r (t - t0)),     p between frames by cubic Hermite interpolation, held beyond the
//     ends
#include <algorithm>

#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class Latency final : public SensorEffect {
  public:
    explicit Latency(const SensorScene& scene) {
        d_.id = "latency";
        d_.kind = "sensor";
        d_.family = "latency";
        d_.summary = "stamps that are late, or a clock of another rate";
        d_.source = "62 ms video, 147-256 ms through a PC: Kibsgaard & Kraus 2017; clock rate assumed";
        d_.parameters = {amplitude("delay", "s", EffectTransform::kIdentity, 0.0, 0.2, -1.0, 2.0),
                         amplitude("rate", "1", EffectTransform::kIdentity, 0.0, 0.005, -0.1, 0.1)};
        if (scene.end_s > scene.start_s)
            d_.candidates.push_back(central_candidate(d_.parameters));
        else
            d_.not_applicable = "the recording has one instant only";
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        const auto t = sighting.time_s;
        if (t.size() < 2 || (v[0] == 0.0 && v[1] == 0.0)) return;
        const auto M = static_cast<Eigen::Index>(sighting.num_markers);
        const Eigen::Matrix3Xd truth = sighting.position;
        const auto frame = [&](std::size_t f) { return truth.middleCols(sighting.column(f, 0), M); };
        const auto slope = [&](std::size_t f) -> Eigen::Matrix3Xd {
            const std::size_t a = f > 0 ? f - 1 : 0, b = std::min(f + 1, t.size() - 1);
            return (frame(b) - frame(a)) / (t[b] - t[a]);
        };
        for (std::size_t f = 0; f < t.size(); ++f) {
            const double at = t[f] - v[0] - v[1] * (t[f] - t[0]);
            auto seen = sighting.position.middleCols(sighting.column(f, 0), M);
            if (at <= t.front()) {
                seen = frame(0);
            } else if (at >= t.back()) {
                seen = frame(t.size() - 1);
            } else {
                const auto b = static_cast<std::size_t>(std::upper_bound(t.begin(), t.end(), at) - t.begin());
                const std::size_t a = b - 1;
                const double h = t[b] - t[a], s = (at - t[a]) / h, r = 1.0 - s;
                seen = (1.0 + 2.0 * s) * r * r * frame(a) + s * s * (3.0 - 2.0 * s) * frame(b) +
                       h * s * r * r * slope(a) - h * s * s * r * slope(b);
            }
        }
    }
};

}  // namespace

std::unique_ptr<SensorEffect> make_latency(const SensorScene& scene) {
    return std::make_unique<Latency>(scene);
}

}  // namespace teres
