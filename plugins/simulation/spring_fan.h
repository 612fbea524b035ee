// A node y of a ligament's free layer with its springs: near ones to surface nodes x_k, far ones to fixed anchors a_k.
//
//     T(d) = w (k0 d^3 + k1 d^2 + k2 d),  d = elongation, 0 for d < 0              tension [N] (paper eq. 3)
//     psi(x) = min_y  sum_k Psi(|x_k - y|) + sum_k Psi(|a_k - y|) + c/2 |y - Y|^2    [J], Psi' = T
//
// Springs run from layer to layer, none within a layer: given the surface, y has a problem of three unknowns. It is
// solved wherever psi is evaluated, so the layer adds no unknowns to the body and a slack one cannot make it singular:
// c = 1e-3 sum w k2 keeps y in place then, and carries no force to x.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "plugins/simulation/body.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

inline constexpr std::size_t kMaxFanSprings = 24;  ///< near ones

struct SpringFan {
    struct Spring {
        NodeIndex node = -1;                               ///< x_k; -1: `anchor`
        Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< a_k [m]
        double rest_length_m = 0.0;
        double weight = 1.0;  ///< w
    };
    std::vector<Spring> near, far;                     ///< the first of each is the straight one
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();  ///< Y [m]
    std::array<double, 3> k{};                         ///< k0 [N/m^3], k1 [N/m^2], k2 > 0 [N/m]
};

/// A layer between the surface points X_i and the anchors X_i + h n_i: one fan per point i, joined to i and to its
/// `neighbours` (indices) in both layers. The diagonals together have the share `diagonal` of the layer's stiffness
/// along n at rest; weights are such that the two layers in series have stiffness k[2] there. `node`: of the points.
std::vector<SpringFan> make_fans(const std::vector<Eigen::Vector3d>& X, const std::vector<Eigen::Vector3d>& n,
                                 const std::vector<NodeIndex>& node,
                                 const std::vector<std::vector<std::size_t>>& neighbours, double h, double diagonal,
                                 const std::array<double, 3>& k);

/// Adds `factor` (one per lane) times energy and gradient of up to kPackLanes lanes. Layouts of tether.h, from lane
/// `first` on.
void add_fan_gradient(const SpringFan& fan, const double* factor, const double* x, double* gradient, double* energy,
                      std::size_t stride, std::size_t first, std::size_t lanes) noexcept;

/// d2psi/dx_a dx_b, the near springs a, b in their order (the layer eliminated): S_a delta_ab - S_a A^-1 S_b.
struct FanStiffness {
    std::array<Eigen::Matrix3d, kMaxFanSprings> S, SA;  ///< S_a and S_a A^-1
    Eigen::Matrix3d block(std::size_t a, std::size_t b) const {
        return a == b ? Eigen::Matrix3d(S[a] - SA[a] * S[b]) : Eigen::Matrix3d(-SA[a] * S[b]);
    }
};
void fan_stiffness(const SpringFan& fan, const Positions& x, FanStiffness& out) noexcept;

}  // namespace teres
