// A body with inertia whose motion is known in closed form: a bar that turns about its end on a spring, and on which a
// constant force acts from t = 0. Markers move along one direction, in proportion to how far out they sit, with
//
//     M q'' + 2 g M q' + K q = G F,   q(0) = q'(0) = 0,   w^2 = K/M - g^2
//     q(t) = G F / K (1 - exp(-g t) (cos w t + g/w sin w t)),   u_m = x_m / L d q
//
//     stiffness s: K = s k                        damping r, T: 2 g = r + T K/M
//     inertia m at x: M = m0 + m (x/L)^2          load_scale a: G = 1 + a
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <vector>

#include "core/extensions/trajectory_model.h"

namespace teres::test {

class ToyOscillator final : public TrajectoryModel {
  public:
    enum Effect : std::size_t { kStiffness, kDamping, kInertia, kLoadScale };

    static constexpr double kSpring = 100.0, kMass = 1.0, kForce = 2.0, kLength = 0.3, kDt = 0.04;
    static constexpr std::size_t kMarkers = 4, kFrames = 64;

    bool held = false;  ///< says that nothing can be damped here

    static double out(std::size_t marker) { return static_cast<double>(marker + 1) / kMarkers; }

    std::size_t num_effects() const noexcept override { return 4; }
    EffectInfo effect(std::size_t e) const noexcept override {
        switch (e) {
            case kStiffness:
                return {"stiffness", "mechanics", "tissue response", "spring", "test", nullptr, 1, 1, false};
            case kDamping:
                return {"damping", "mechanics", "damping", "dies out", "test", held ? "held" : nullptr, 2, 1, false};
            case kInertia:
                return {"inertia", "mechanics", "inertia", "mass", "test", nullptr, 4, 3, false};
            default:
                return {"load_scale", "load", "load_scale", "gain", "test", nullptr, 1, 1, false};
        }
    }
    EffectParameter effect_parameter(std::size_t e, std::size_t p) const noexcept override {
        const auto plain = EffectTransform::kIdentity;
        const auto amplitude = EffectRole::kAmplitude, shape = EffectRole::kShape;
        if (e == kStiffness) return {"factor", "1", amplitude, EffectTransform::kLog, 1.0, 0.0, 0.5, 0.1, 10.0};
        if (e == kDamping && p == 0) return {"mass_rate", "1/s", amplitude, plain, 0.0, 0.0, 4.0, 0.0, 100.0};
        if (e == kDamping) return {"stiffness_time", "s", amplitude, plain, 0.0, 0.0, 0.01, 0.0, 0.2};
        if (e == kLoadScale) return {"gain", "1", amplitude, plain, 0.0, 0.0, 0.35, -1.0, 4.0};
        if (p == 0) return {"mass", "kg", amplitude, plain, 0.0, 0.0, 0.3, 0.0, 20.0};
        static constexpr std::array kNames{"mass", "center_x", "center_y", "center_z"};
        const double most = p == 1 ? kLength : 1e-3;
        return {kNames[p], "m", shape, plain, 0.0, 0.5 * most, 0.5 * most, 0.0, most};
    }
    void effect_candidate(std::size_t e, std::size_t c, std::span<double> v) const noexcept override {
        if (e == kStiffness) v[0] = std::exp(0.5);
        if (e == kDamping) v[0] = 4.0, v[1] = 0.01;
        if (e == kInertia) v[0] = 0.3, v[1] = kLength * static_cast<double>(c + 1) / 3.0, v[2] = v[3] = 0.0;
        if (e == kLoadScale) v[0] = 0.35;
    }

    bool dynamic() const noexcept override { return true; }
    void set_horizon(std::size_t num_frames) noexcept override { horizon_ = num_frames; }
    std::size_t num_parameters() const noexcept override { return 0; }
    NominalParameter parameter(std::size_t) const noexcept override { return {}; }
    std::size_t num_frames() const noexcept override { return kFrames; }
    double time_s(std::size_t f) const noexcept override { return kDt * static_cast<double>(f); }
    std::size_t num_markers() const noexcept override { return kMarkers; }
    std::int32_t marker_id(std::size_t m) const noexcept override { return static_cast<std::int32_t>(m); }
    std::size_t num_points() const noexcept override { return 0; }
    std::int32_t point_id(std::size_t) const noexcept override { return 0; }
    std::size_t num_nodes() const noexcept override { return kMarkers; }
    void rest_positions(std::span<double> x) const noexcept override {
        std::fill(x.begin(), x.end(), 0.0);
        for (std::size_t m = 0; m < kMarkers; ++m) x[3 * m] = kLength * out(m);
    }
    std::size_t num_surface_triangles() const noexcept override { return 0; }
    void surface_triangles(std::span<std::int32_t>) const noexcept override {}

    /// The closed form above, of all frames.
    static std::vector<double> motion(std::span<const EffectInstance> effects, std::size_t frames = kFrames) {
        double K = kSpring, M = kMass, rate = 0.0, time = 0.0, gain = 1.0;
        for (const EffectInstance& e : effects) {
            if (e.index == kStiffness) K *= e.values[0];
            if (e.index == kDamping) rate = e.values[0], time = e.values[1];
            if (e.index == kInertia) M += e.values[0] * std::pow(e.values[1] / kLength, 2);
            if (e.index == kLoadScale) gain += e.values[0];
        }
        const double g = 0.5 * (rate + time * K / M);
        const std::complex<double> w = std::sqrt(std::complex<double>(K / M - g * g + 1e-12));
        const Eigen::Vector3d direction(0.1, 0.3, -0.9);
        std::vector<double> markers(3 * kMarkers * kFrames);
        for (std::size_t f = 0; f < kFrames; ++f) {
            const double t = kDt * static_cast<double>(std::min(f, frames - 1));
            const double q =
                gain * kForce / K * (1.0 - (std::exp(-g * t) * (std::cos(w * t) + g / w * std::sin(w * t))).real());
            for (std::size_t m = 0; m < kMarkers; ++m)
                for (std::size_t a = 0; a < 3; ++a)
                    markers[3 * (f * kMarkers + m) + a] =
                        (a == 0 ? kLength * out(m) : 0.0) + direction(static_cast<Eigen::Index>(a)) * out(m) * q;
        }
        return markers;
    }
    TrajectoryReport simulate(const Hypothesis& h, std::span<double> markers, std::span<double>,
                              std::span<double>) noexcept override {
        base_ = motion(h.effects, frames());
        std::copy(base_.begin(), base_.end(), markers.begin());
        return {kFrames, kFrames, 0.0};
    }
    bool first_order(std::span<const Hypothesis> others, std::span<double> markers,
                     std::span<double>) noexcept override {
        for (std::size_t k = 0; k < others.size(); ++k) {
            const auto other = motion(others[k].effects, frames());
            for (std::size_t row = 0; row < base_.size(); ++row)
                markers[k * base_.size() + row] = other[row] - base_[row];
        }
        return true;
    }
    TrajectoryReport simulate_at(const Hypothesis& h, std::span<const std::int32_t> listed,
                                 std::span<double> markers) noexcept override {
        const auto all = motion(h.effects);
        for (std::size_t k = 0; k < listed.size(); ++k)
            std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(3 * kMarkers) * listed[k], 3 * kMarkers,
                        markers.begin() + static_cast<std::ptrdiff_t>(3 * kMarkers * k));
        return {static_cast<std::int32_t>(listed.size()), static_cast<std::int32_t>(listed.size()), 0.0};
    }
    bool marker_compliance(std::int32_t, std::span<double>) const noexcept override { return false; }
    std::size_t num_variants() const noexcept override { return 0; }
    const char* variant_name(std::size_t) const noexcept override { return ""; }
    TrajectoryReport simulate_variant(std::size_t, const Hypothesis&, std::span<const std::int32_t>, std::span<double>,
                                      std::span<double>) noexcept override {
        return {};
    }

  private:
    std::size_t frames() const { return horizon_ > 0 ? std::min(horizon_, kFrames) : kFrames; }
    std::size_t horizon_ = 0;
    std::vector<double> base_ = std::vector<double>(3 * kMarkers * kFrames);
};

}  // namespace teres::test
