#include "plugins/observation/stereo_lift.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace teres {
namespace {

constexpr double kParallel = 1e-9;  // determinant, sine squared of the angle between the rays
constexpr double kFloor_m = 1e-3;   // how well a guess can be met: nearer counts as this

Eigen::Vector3d vec(const Point& p) {
    return {p[0], p[1], p[2]};
}

}  // namespace

std::optional<LiftedPoint> triangulate(const StereoPair& pair, const Pixel& left, const Pixel& right,
                                       const LiftOptions& lift, double max_gap_m) {
    const Eigen::Vector3d r1 = vec(pair.left.ray(left)), r2 = vec(pair.right_to_left.rotate(pair.right.ray(right)));
    const Eigen::Vector3d t = vec(pair.right_to_left.t);
    Eigen::Matrix2d A;
    A << r1.dot(r1), -r1.dot(r2), -r1.dot(r2), r2.dot(r2);
    if (std::abs(A.determinant()) < kParallel) return std::nullopt;
    const Eigen::Vector2d z = A.inverse() * Eigen::Vector2d(r1.dot(t), -r2.dot(t));
    if (!(z[0] > 0.0) || !(z[1] > 0.0)) return std::nullopt;
    const Eigen::Vector3d a = z[0] * r1, b = t + z[1] * r2;
    if ((a - b).norm() > max_gap_m) return std::nullopt;
    LiftedPoint point;
    point.x = 0.5 * (a + b);
    const double sigma_z =
        point.x[2] * point.x[2] * lift.pixel_sigma * std::numbers::sqrt2 / (pair.left.fx_px * t.norm());
    point.covariance = ray_covariance(r1, point.x[2], lift.pixel_sigma, pair.left.fx_px, sigma_z);
    return point;
}

std::optional<LiftedPoint> StereoLift::at(const Blob& dot, double guess_z_m) const {
    std::optional<LiftedPoint> best;
    const Blob* partner = nullptr;
    double nearest = meeting_.depth_gate_m, second = nearest * meeting_.unmistakable;
    for (const Blob& other : dots_) {
        const auto point = triangulate(pair_, dot.center, other.center, lift_, meeting_.max_gap_m);
        if (!point) continue;
        const double off = std::max(kFloor_m, std::abs(point->x.z() - guess_z_m));
        if (off >= nearest) {
            second = std::min(second, off);
            continue;
        }
        if (best) second = nearest;
        nearest = off;
        best = point;
        partner = &other;
    }
    if (!best || second < meeting_.unmistakable * nearest) return std::nullopt;
    const auto [small, large] = std::minmax(dot.area_px, partner->area_px);
    return small < meeting_.min_area_ratio * large ? std::nullopt : best;
}

}  // namespace teres
