#include "plugins/observation/lift.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr double kCorrelatedPixels = 12.0;  // neighbours share one matching window: so many count as one
constexpr std::size_t kMinSamples = 12;
constexpr double kMinIncidence = 0.28;  // cosine, 74 degrees: flatter, a shift of a pixel is one of millimetres

Eigen::Vector3d vec(const Point& p) {
    return {p[0], p[1], p[2]};
}

struct Sample {
    double du, dv, inverse_z;
};

double median(std::vector<double>& values) {
    const auto middle = values.begin() + std::ssize(values) / 2;
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace

Eigen::Matrix3d ray_covariance(const Eigen::Vector3d& ray, double z_m, double pixel_sigma, double focal_px,
                               double sigma_z_m) {
    const double across = pixel_sigma * z_m / focal_px;
    Eigen::Matrix3d covariance = sigma_z_m * sigma_z_m * ray * ray.transpose();
    covariance.diagonal().head<2>().array() += across * across;
    return covariance;
}

std::optional<LiftedPoint> DepthLift::at(const Blob& dot, double guess_z_m) const {
    const Point ray = tracking_.ray(dot.center);
    const auto& R = to_depth_.R;
    const double slope = R[6] * ray[0] + R[7] * ray[1] + R[8] * ray[2];  // z of the depth camera per z of this one
    double z = guess_z_m;
    std::optional<Depth> found;
    for (int i = 0; i < 4; ++i) {
        const auto seen = depth_.project(to_depth_.apply({ray[0] * z, ray[1] * z, z}));
        if (!seen) return std::nullopt;
        found = depth_at(*seen, z);
        if (!found) return std::nullopt;
        const double next = (found->z_m - to_depth_.t[2]) / slope;
        const bool settled = std::abs(next - z) < 1e-5;
        z = next;
        if (settled) break;
    }
    LiftedPoint point;
    point.x = z * vec(ray);
    point.covariance = ray_covariance(vec(ray), z, options_.pixel_sigma, tracking_.fx_px, found->sigma_m);
    return point;
}

std::optional<DepthLift::Depth> DepthLift::depth_at(const Pixel& pixel, double guess_z_m) const {
    const int radius =
        std::clamp(static_cast<int>(std::lround(options_.window_radius_m * depth_.fx_px / guess_z_m)), 2, 12);
    const int cu = static_cast<int>(std::lround(pixel.u)), cv = static_cast<int>(std::lround(pixel.v));
    if (cu < radius || cv < radius || cu + radius >= counts_.cols || cv + radius >= counts_.rows) return std::nullopt;
    std::vector<Sample> samples;
    std::size_t asked = 0;
    for (int v = cv - radius; v <= cv + radius; ++v)
        for (int u = cu - radius; u <= cu + radius; ++u) {
            if ((u - cu) * (u - cu) + (v - cv) * (v - cv) > radius * radius) continue;
            ++asked;
            if (const std::uint16_t counts = counts_.at<std::uint16_t>(v, u); counts > 0)
                samples.push_back({u - pixel.u, v - pixel.v, 1.0 / (counts * unit_m_)});
        }
    const auto enough = [&] {
        return samples.size() >= kMinSamples &&
               static_cast<double>(samples.size()) >= options_.min_valid_share * static_cast<double>(asked);
    };
    if (!enough()) return std::nullopt;

    std::vector<double> values(samples.size());
    std::transform(samples.begin(), samples.end(), values.begin(), [](const Sample& s) { return s.inverse_z; });
    Eigen::Vector3d plane(median(values), 0.0, 0.0);
    double scale = 0.0;
    for (int pass = 0; pass < 3; ++pass) {
        values.clear();
        const auto off = [&](const Sample& s) {
            return std::abs(s.inverse_z - plane[0] - plane[1] * s.du - plane[2] * s.dv);
        };
        for (const Sample& s : samples) values.push_back(off(s));
        // Scaled median deviation, never below the rounding of a depth count.
        scale = std::max(1.4826 * median(values), 0.5 * unit_m_ * plane[0] * plane[0]);
        std::erase_if(samples, [&](const Sample& s) { return off(s) > 3.0 * scale; });
        if (!enough()) return std::nullopt;
        Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
        Eigen::Vector3d b = Eigen::Vector3d::Zero();
        for (const Sample& s : samples) {
            const Eigen::Vector3d row(1.0, s.du, s.dv);
            A += row * row.transpose();
            b += s.inverse_z * row;
        }
        plane = A.ldlt().solve(b);
        if (!plane.allFinite() || !(plane[0] > 0.0)) return std::nullopt;
    }
    const double z = 1.0 / plane[0], spread = scale * z * z;
    if (spread > options_.max_spread_m) return std::nullopt;
    // With x = X/Z, y = Y/Z the fit is the plane n·(x, y, 1) = 1/z; its cosine with the ray is (1/z) / (|n| |ray|).
    const Point r = depth_.ray(pixel);
    const double nx = plane[1] * depth_.fx_px, ny = plane[2] * depth_.fy_px, nz = plane[0] - nx * r[0] - ny * r[1];
    if (plane[0] < kMinIncidence * std::hypot(nx, ny, nz) * std::hypot(r[0], r[1], 1.0)) return std::nullopt;
    const double single = std::max(options_.depth_noise_per_m * z * z, spread);
    const double independent = std::max(1.0, static_cast<double>(samples.size()) / kCorrelatedPixels);
    return Depth{z, single / std::sqrt(independent)};
}

}  // namespace teres
