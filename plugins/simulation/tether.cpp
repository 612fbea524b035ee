#include "plugins/simulation/tether.h"

#include <algorithm>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr double kTaut = 0.02;  // share of a slack band that stays taut

Matrix3d band_stiffness(const BandPatch& band) {
    const Matrix3d nn = band.normal * band.normal.transpose();
    return nn + band.shear_ratio * (Matrix3d::Identity() - nn);
}

// Energy and gradient at theta = 1.
double energy_and_gradient(const Tether& t, const Vector3d& x, Vector3d& gradient) noexcept {
    switch (t.kind) {
        case Tether::Kind::kBand: {
            const Vector3d u = x - t.band.rest;
            const double normal = u.dot(t.band.normal);
            const Vector3d tangential = u - normal * t.band.normal;
            gradient = t.share * (normal * t.band.normal + t.band.shear_ratio * tangential);
            const double energy = 0.5 * gradient.dot(u), length = u.norm(), z = t.band.dead_zone_m;
            if (z == 0.0) return energy;
            gradient *= kTaut;
            if (length <= z) return kTaut * energy;
            // v = u (1 - z/|u|), dv/du = I - z/|u| (I - e e^T), e = u/|u|
            const Vector3d e = u / length, a = (1.0 - kTaut) * t.share * (band_stiffness(t.band) * (u - z * e));
            gradient += (1.0 - z / length) * a + z / length * e.dot(a) * e;
            return kTaut * energy + 0.5 * a.dot(u - z * e);
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
            const double z = t.band.dead_zone_m;
            if (z == 0.0) return A;
            const Vector3d u = x - t.band.rest;
            const double length = u.norm();
            if (length <= z) return kTaut * A;
            // J A J + sum_k a_k d2v_k/du2, a = A v, d2v/du2 from that of the unit vector e
            const Vector3d e = u / length, a = (1.0 - kTaut) * A * (u - z * e);
            const Matrix3d I = Matrix3d::Identity(), J = I - z / length * (I - e * e.transpose());
            return kTaut * A + (1.0 - kTaut) * J * A * J +
                   z / (length * length) *
                       (a.dot(e) * (I - 3.0 * e * e.transpose()) + a * e.transpose() + e * a.transpose());
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
