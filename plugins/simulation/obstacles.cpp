#include "plugins/simulation/obstacles.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void Obstacles::add_gradient(const double* x, double* gradient, double* energy, std::size_t stride,
                             std::size_t lanes) const noexcept {
    for (const auto& o : obstacles_)
        for (std::size_t k = 0; k < o.node.size(); ++k) {
            const std::size_t d = 3 * static_cast<std::size_t>(o.node[k]) * stride;
            const double stiffness = o.stiffness_n_per_m3 * o.area_m2[k];
            for (std::size_t l = 0; l < lanes; ++l) {
                const Vector3d r = Vector3d(x[d + l], x[d + stride + l], x[d + 2 * stride + l]) - o.centre;
                const double length = r.norm(), depth = length - o.radius_m;
                if (depth >= 0.0 || length == 0.0) continue;
                energy[l] += 0.5 * stiffness * depth * depth;
                for (std::size_t a = 0; a < 3; ++a)
                    gradient[d + a * stride + l] += stiffness * depth / length * r(static_cast<Eigen::Index>(a));
            }
        }
}

// K = k a [ n n^T + d/|r| (I - n n^T) ]
void Obstacles::add_tangent(const Positions& x, const BlockPattern& pattern,
                            std::vector<double>& values) const noexcept {
    for (const auto& o : obstacles_)
        for (std::size_t k = 0; k < o.node.size(); ++k) {
            const Vector3d r = x.col(o.node[k]) - o.centre;
            const double length = r.norm(), depth = length - o.radius_m;
            if (depth >= 0.0 || length == 0.0) continue;
            const Matrix3d nn = r * r.transpose() / (length * length);
            const Matrix3d K =
                o.stiffness_n_per_m3 * o.area_m2[k] * (nn + depth / length * (Matrix3d::Identity() - nn));
            pattern.add(o.node[k], o.node[k], pattern.block(o.node[k], o.node[k]), K, values);
        }
}

}  // namespace teres
