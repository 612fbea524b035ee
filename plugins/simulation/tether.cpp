#include "plugins/simulation/tether.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// Energy and gradient at theta = 1.
double energy_and_gradient(const Tether& t, const Vector3d& x, Vector3d& gradient) noexcept {
    switch (t.kind) {
        case Tether::Kind::kBand: {
            const Vector3d u = x - t.band.rest;
            const double normal = u.dot(t.band.normal);
            const Vector3d tangential = u - normal * t.band.normal;
            gradient = t.share * (normal * t.band.normal + t.band.shear_ratio * tangential);
            return 0.5 * gradient.dot(u);
        }
        case Tether::Kind::kSpring:
            gradient = -t.share * t.spring.force(x);
            return t.share * t.spring.energy(x);
        case Tether::Kind::kBar: {
            const Vector3d d = x - t.spring.anchor;
            const double length = d.norm(), stretch = length - t.spring.rest_length,
                         k = t.share * t.spring.k[0];
            gradient = length > 0.0 ? Vector3d(k * stretch / length * d) : Vector3d::Zero();
            return 0.5 * k * stretch * stretch;
        }
    }
    return 0.0;
}

}  // namespace

void add_tether_gradient(const std::vector<Tether>& tethers, const double* theta, const double* x,
                         double* gradient, double* energy, std::size_t stride, std::size_t lanes) noexcept {
    for (const auto& t : tethers) {
        const std::size_t d = 3 * static_cast<std::size_t>(t.node);
        for (std::size_t l = 0; l < lanes; ++l) {
            const double k =
                t.parameter < 0 ? 1.0 : theta[static_cast<std::size_t>(t.parameter) * stride + l];
            Vector3d g = Vector3d::Zero();
            energy[l] += k * energy_and_gradient(
                                 t, {x[d * stride + l], x[(d + 1) * stride + l], x[(d + 2) * stride + l]}, g);
            for (std::size_t a = 0; a < 3; ++a)
                gradient[(d + a) * stride + l] += k * g(static_cast<Eigen::Index>(a));
        }
    }
}

Matrix3d tether_stiffness(const Tether& t, const Vector3d& x) noexcept {
    switch (t.kind) {
        case Tether::Kind::kBand: {
            const Matrix3d nn = t.band.normal * t.band.normal.transpose();
            return t.share * (nn + t.band.shear_ratio * (Matrix3d::Identity() - nn));
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
    }
    return Matrix3d::Zero();
}

void add_tether_tangent(const std::vector<Tether>& tethers, const double* theta, const Positions& x,
                        const BlockPattern& pattern, std::vector<double>& values) noexcept {
    for (const auto& t : tethers) {
        const double k = t.parameter < 0 ? 1.0 : theta[static_cast<std::size_t>(t.parameter)];
        pattern.add(t.node, t.node, pattern.block(t.node, t.node), k * tether_stiffness(t, x.col(t.node)),
                    values);
    }
}

}  // namespace teres
