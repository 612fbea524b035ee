#include "plugins/simulation/tether.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void add_tether_gradient(const std::vector<Tether>& tethers, const double* theta, const double* x,
                         double* gradient, double* energy, std::size_t stride, std::size_t lanes) noexcept {
    for (const auto& t : tethers) {
        const std::size_t d = 3 * static_cast<std::size_t>(t.node);
        for (std::size_t l = 0; l < lanes; ++l) {
            const double k =
                t.share * (t.parameter < 0 ? 1.0 : theta[static_cast<std::size_t>(t.parameter) * stride + l]);
            const Vector3d position(x[d * stride + l], x[(d + 1) * stride + l], x[(d + 2) * stride + l]);
            const Vector3d u = position - t.band.rest;
            const double normal = u.dot(t.band.normal);
            const Vector3d tangential = u - normal * t.band.normal;
            energy[l] += 0.5 * k * (normal * normal + t.band.shear_ratio * tangential.squaredNorm());
            const Vector3d g = k * (normal * t.band.normal + t.band.shear_ratio * tangential);
            for (std::size_t a = 0; a < 3; ++a)
                gradient[(d + a) * stride + l] += g(static_cast<Eigen::Index>(a));
        }
    }
}

Matrix3d tether_stiffness(const Tether& t, const Vector3d&) noexcept {
    const Matrix3d nn = t.band.normal * t.band.normal.transpose();
    return t.share * (nn + t.band.shear_ratio * (Matrix3d::Identity() - nn));
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
