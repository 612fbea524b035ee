// marker_slip: one marker slips from some time on, or two markers are taken for each other during a while.
//
//     p_m'(t) = p_m(t) + d                              t >= onset
//     p_m'(t) = (1 - q) p_m + q p_n, and the reverse    onset <= t < end        q = 1: exchanged
#include <algorithm>
#include <cmath>

#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

constexpr int kOnsets = 12;     // of the search grid
constexpr int kNeighbours = 3;  // markers that are mistaken for each other are near each other
constexpr int kSwapOnsets = 6;

class MarkerSlip final : public SensorEffect {
  public:
    explicit MarkerSlip(const SensorScene& scene) : rest_(scene.marker) {
        d_.id = "marker_slip";
        d_.kind = "sensor";
        d_.family = "marker_slip";
        d_.summary = "one marker that slips, or two that are exchanged for a while";
        d_.source = "assumed: slips of some millimetres";
        d_.event = true;
        const double t0 = scene.start_s, t1 = scene.end_s, last = static_cast<double>(rest_.size()) - 1.0;
        d_.parameters = {choice("marker", "1", 0.0, std::max(last, 1.0), 0.0, std::max(last, 0.0)),
                         choice("partner", "1", 0.0, std::max(last, 1.0), 0.0, std::max(last, 0.0)),
                         choice("onset", "s", t0, t1 - t0, t0 - (t1 - t0), t1),
                         choice("end", "s", t1, t1 - t0, t0, t1 + (t1 - t0)),
                         amplitude("slip_x", "m", EffectTransform::kIdentity, 0.0, 0.006, -0.06, 0.06),
                         amplitude("slip_y", "m", EffectTransform::kIdentity, 0.0, 0.006, -0.06, 0.06),
                         amplitude("slip_z", "m", EffectTransform::kIdentity, 0.0, 0.006, -0.06, 0.06),
                         amplitude("exchange", "1", EffectTransform::kIdentity, 0.0, 1.0, -0.5, 1.5)};
        if (!(t1 > t0)) {
            d_.not_applicable = "the recording has one instant only";
            return;
        }
        const double slip = one_sigma(d_.parameters[4]);
        for (std::size_t m = 0; m < rest_.size(); ++m)
            for (int k = 0; k < kOnsets; ++k) {
                const double onset = t0 + (t1 - t0) * k / kOnsets;
                d_.candidates.push_back({double(m), double(m), onset, t1, slip, slip, slip, 0.0});
            }
        for (std::size_t m = 0; m < rest_.size(); ++m)
            for (const std::size_t n : nearest(m))
                for (int from = 0; from < kSwapOnsets; ++from)
                    for (int to = from + 1; to <= kSwapOnsets; ++to)
                        d_.candidates.push_back({double(m), double(n), t0 + (t1 - t0) * from / kSwapOnsets,
                                                 to == kSwapOnsets ? 2.0 * t1 - t0 : t0 + (t1 - t0) * to / kSwapOnsets,
                                                 0.0, 0.0, 0.0, 1.0});
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        const auto M = static_cast<double>(sighting.num_markers);
        const double m = std::round(v[0]), n = std::round(v[1]);
        if (!(m >= 0.0 && m < M && n >= 0.0 && n < M)) return;
        for (std::size_t f = 0; f < sighting.time_s.size(); ++f) {
            const double t = sighting.time_s[f];
            auto p = sighting.position.col(sighting.column(f, static_cast<std::size_t>(m)));
            auto q = sighting.position.col(sighting.column(f, static_cast<std::size_t>(n)));
            if (t >= v[2] && t < v[3] && m != n) {
                const Eigen::Vector3d difference = v[7] * (q - p);
                p += difference;
                q -= difference;
            }
            if (t >= v[2]) p += Eigen::Vector3d(v[4], v[5], v[6]);
        }
    }

  private:
    // Neighbours with a larger index (pairs are symmetric).
    std::vector<std::size_t> nearest(std::size_t m) const {
        std::vector<std::size_t> others;
        for (std::size_t n = 0; n < rest_.size(); ++n)
            if (n != m) others.push_back(n);
        const auto count = std::min<std::size_t>(others.size(), kNeighbours);
        std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count), others.end(),
                          [&](std::size_t a, std::size_t b) {
                              return (rest_[a] - rest_[m]).squaredNorm() < (rest_[b] - rest_[m]).squaredNorm();
                          });
        others.resize(count);
        std::erase_if(others, [&](std::size_t n) { return n < m; });
        return others;
    }
    std::vector<Eigen::Vector3d> rest_;
};

}  // namespace

std::unique_ptr<SensorEffect> make_marker_slip(const SensorScene& scene) {
    return std::make_unique<MarkerSlip>(scene);
}

}  // namespace teres
