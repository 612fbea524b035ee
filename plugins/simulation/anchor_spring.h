// Springs between one node x and a fixed or moving anchor p, by law.
//
//   d = p - x, L = |d|, n = d / L, delta = L - L0, e = delta / L0
//
//   kRestShape              f = k1 d                                    pushes and pulls, zero length k1
//   [N/m] kPolynomialTension      f = F(e) n, F = k1 e + k2 e^2 + k3 e^3      zero for L < L0 (slack) k_i [N]
//   kCubicTension           f = F(delta) n, F = k1 delta^3 + k2 delta^2 + k3 delta   zero for delta < 0
//                           (k1 [N/m^3], k2 [N/m^2], k3 [N/m]: ka, kb, kg of the ligament law)
//   kPolynomialRestShape    f = F(L / L0) d / sqrt(L^2 + exp(b - c L^2))   zero force at the anchor; the
//   smoothed
//                           direction is defined there too             k_i [N], b [ln m^2], c [1/m^2]
//
// Each law as energy, force on the node and stiffness S = -df/dx (3x3), checked against each other by
// differences.
#pragma once

#include <Eigen/Core>
#include <array>

#include "core/case/case.h"

namespace teres {

enum class AnchorLaw { kRestShape, kPolynomialTension, kCubicTension, kPolynomialRestShape };

struct AnchorSpring {
    AnchorLaw law = AnchorLaw::kRestShape;
    std::int32_t node = 0;
    Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< [m]
    std::array<double, 3> k{};                         ///< units above
    double rest_length = 0.0;                          ///< L0 > 0 except for kRestShape [m]
    /// The peer keeps the tangent of a slack polynomial spring, with e = |L - L0| / L0; the force is zero all
    /// the same.
    bool stiff_when_slack = false;
    /// The peer's tangent of kPolynomialRestShape keeps only the diagonal of S.
    bool diagonal_stiffness = false;
    double smooth_shift = 0.0;  ///< b
    double smooth_scale = 1.0;  ///< c; the direction is that of d once c L^2 >> b - ln L^2

    /// Stored energy [J]. kPolynomialRestShape: of the unsmoothed direction.
    double energy(const Eigen::Vector3d& x) const noexcept;
    Eigen::Vector3d force(const Eigen::Vector3d& x) const noexcept;
    Eigen::Matrix3d stiffness(const Eigen::Vector3d& x) const noexcept;
};

}  // namespace teres
