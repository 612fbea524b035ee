// The elastic body: energy, forces and tangent of all its strain points, for one state or for a batch of
// lanes.
//
//   Psi(x)  = sum_q V_q s_q psi(F_q)                                 [J]
//   f_i     = -dPsi/dx_i = -sum_q V_q s_q P(F_q) dN_i/dX             [N]
//   K_ij    = d2Psi/dx_i dx_j = sum_q V_q s_q (dN_i . A(F_q) . dN_j)  [N/m]
//
// Batch layout: value of dof d in lane l at d * stride + l; stride is a multiple of kPackLanes (lane = SIMD
// lane).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <set>
#include <vector>

#include "plugins/simulation/block_pattern.h"
#include "plugins/simulation/material.h"
#include "plugins/simulation/point_shares.h"
#include "plugins/simulation/strain_points.h"

namespace teres {

inline constexpr std::size_t kPackLanes = 4;

inline std::size_t padded_lanes(std::size_t lanes) {
    return (lanes + kPackLanes - 1) / kPackLanes * kPackLanes;
}

class Body {
  public:
    Body(std::vector<StrainPoints> points, Material material);

    const Material& material() const { return material_; }
    const std::vector<StrainPoints>& points() const { return points_; }
    std::vector<StrainPoints>& points() { return points_; }

    /// Adds the couplings of all strain points.
    void couple(std::vector<std::set<NodeIndex>>& neighbours) const;
    /// [setup] Fixes where each point's blocks go.
    void bind(const BlockPattern& pattern);

    /// [loop] One thread's share of energy and gradient dPsi/dx of every lane, added to `energy` (one per
    /// lane), `gradient` and `spare` (point_shares.h). A lane whose F is outside the law's domain gets
    /// infinite energy. Lanes from `lanes` on need not count.
    void add_gradient(const PointShares& shares, int rank, const double* x, double* gradient, double* spare,
                      double* energy, std::size_t stride, std::size_t lanes) const noexcept;
    /// [loop] Adds the tangent of one state (x: num_nodes columns) to `values`. False outside the law's
    /// domain.
    bool add_tangent(const Positions& x, const BlockPattern& pattern, std::vector<double>& values) const noexcept;

  private:
    static constexpr std::size_t kMostAlike = 2;

    bool tangent_at(const std::vector<std::size_t>& sets, std::size_t q, const Eigen::Matrix3d& F,
                    Matrix9d& A) const noexcept;

    std::vector<StrainPoints> points_;
    Material material_;
    std::vector<std::vector<std::size_t>> alike_;    // numbers of sets whose points have the same nodes and dN/dX
    std::vector<std::vector<std::int32_t>> blocks_;  // of those sets: block index per node pair (row <= column)
};

}  // namespace teres
