#include "plugins/simulation/tether.h"

#include <algorithm>
#include <cmath>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kTaut = 0.02;         // share of a slack band that stays solid
constexpr double kSoonSlack_m = 1e-3;  // dead zone within which a band turns from solid to strings

Matrix3d band_stiffness(const BandPatch& band) {
    const Matrix3d nn = band.normal * band.normal.transpose();
    return nn + band.shear_ratio * (Matrix3d::Identity() - nn);
}

double solid_share(const BandPatch& band) {
    return std::max(kTaut, std::exp(-band.dead_zone_m / kSoonSlack_m));
}

// The string of a slack band with its node at x: unit vector to the far edge, length, elongation beyond the dead zone.
struct SlackString {
    Vector3d direction;
    double length, elongation;
};
SlackString slack_string(const BandPatch& band, const Vector3d& x) {
    const Vector3d d = band.rest + band.height_m * band.normal - x;
    const double length = d.norm();
    return {length > 0.0 ? Vector3d(d / length) : band.normal, length, length - band.height_m - band.dead_zone_m};
}

// Energy and gradient at theta = 1.
double energy_and_gradient(const Tether& t, const Vector3d& x, Vector3d& gradient) noexcept {
    switch (t.kind) {
        case Tether::Kind::kBand: {
            const Vector3d u = x - t.band.rest;
            const double normal = u.dot(t.band.normal);
            const Vector3d tangential = u - normal * t.band.normal;
            gradient = t.share * (normal * t.band.normal + t.band.shear_ratio * tangential);
            const double energy = 0.5 * gradient.dot(u);
            if (t.band.dead_zone_m == 0.0) return energy;
            const double solid = solid_share(t.band), k = (1.0 - solid) * t.share;
            gradient *= solid;
            const SlackString string = slack_string(t.band, x);
            if (string.elongation <= 0.0) return solid * energy;
            gradient -= k * string.elongation * string.direction;
            return solid * energy + 0.5 * k * string.elongation * string.elongation;
        }
        case Tether::Kind::kSpring:
            gradient = -t.share * t.spring.force(x);
            return t.share * t.spring.energy(x);
        case Tether::Kind::kBar: {
            const Vector3d d = x - t.spring.anchor;
            const double length = d.norm(), stretch = length - t.spring.rest_length, k = t.share * t.spring.k[0];
            gradient = length > 0.0 ? Vector3d(k * stretch / length * d) : Vector3d::Zero();
            return 0.5 * k * stretch * stretch;
        }
        case Tether::Kind::kFan:
            break;  // of several nodes: add_fan_gradient
    }
    return 0.0;
}

}  // namespace

void add_tether_gradient(const std::vector<Tether>& tethers, const double* theta, const double* x, double* gradient,
                         double* energy, std::size_t stride, std::size_t lanes) noexcept {
    for (const auto& t : tethers) {
        const auto theta_of = [&](std::size_t l) {
            return t.parameter < 0 ? 1.0 : theta[static_cast<std::size_t>(t.parameter) * stride + l];
        };
        if (t.kind == Tether::Kind::kFan) {
            for (std::size_t first = 0; first < lanes; first += kPackLanes) {
                std::array<double, kPackLanes> factor{};
                for (std::size_t l = 0; l < kPackLanes; ++l)
                    factor[l] = t.share * theta_of(std::min(first + l, lanes - 1));
                add_fan_gradient(t.fan, factor.data(), x, gradient, energy, stride, first, lanes);
            }
            continue;
        }
        const std::size_t d = 3 * static_cast<std::size_t>(t.node);
        for (std::size_t l = 0; l < lanes; ++l) {
            const double k = theta_of(l);
            Vector3d g = Vector3d::Zero();
            energy[l] +=
                k * energy_and_gradient(t, {x[d * stride + l], x[(d + 1) * stride + l], x[(d + 2) * stride + l]}, g);
            for (std::size_t a = 0; a < 3; ++a) gradient[(d + a) * stride + l] += k * g(static_cast<Eigen::Index>(a));
        }
    }
}

Matrix3d tether_stiffness(const Tether& t, const Vector3d& x) noexcept {
    switch (t.kind) {
        case Tether::Kind::kBand: {
            const Matrix3d A = t.share * band_stiffness(t.band);
            if (t.band.dead_zone_m == 0.0) return A;
            const double solid = solid_share(t.band), k = (1.0 - solid) * t.share;
            const SlackString string = slack_string(t.band, x);
            if (string.elongation <= 0.0) return solid * A;
            const Matrix3d nn = string.direction * string.direction.transpose();
            return solid * A + k * (nn + string.elongation / string.length * (Matrix3d::Identity() - nn));
        }
        case Tether::Kind::kSpring:
            return t.share * t.spring.stiffness(x);
        case Tether::Kind::kBar: {
            const Vector3d d = x - t.spring.anchor;
            const double length = d.norm(), k = t.share * t.spring.k[0];
            if (length == 0.0) return Matrix3d::Zero();  // no direction
            const Matrix3d nn = d * d.transpose() / (length * length);
            return k * (nn + (1.0 - t.spring.rest_length / length) * (Matrix3d::Identity() - nn));
        }
        case Tether::Kind::kFan:
            break;
    }
    return Matrix3d::Zero();
}

void add_tether_tangent(const std::vector<Tether>& tethers, const double* theta, const Positions& x,
                        const BlockPattern& pattern, std::vector<double>& values) noexcept {
    for (const auto& t : tethers) {
        const double k = t.parameter < 0 ? 1.0 : theta[static_cast<std::size_t>(t.parameter)];
        for_stiffness_blocks(t, x, [&](std::size_t i, std::size_t j, const Matrix3d& K) {
            const NodeIndex a = t.node_at(i), b = t.node_at(j);
            if (a <= b) pattern.add(a, b, pattern.block(a, b), k * K, values);
        });
    }
}

void couple(const std::vector<Tether>& tethers, std::vector<std::set<NodeIndex>>& neighbours) {
    for (const auto& t : tethers)
        for (std::size_t i = 0; i < t.num_nodes(); ++i)
            for (std::size_t j = 0; j < t.num_nodes(); ++j)
                if (i != j) neighbours[static_cast<std::size_t>(t.node_at(i))].insert(t.node_at(j));
}

}  // namespace teres
