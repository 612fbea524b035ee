// What ties nodes of the body to its surroundings: ligament bands, springs to anchors, tools. Each acts on
// one node, a fan of a two-layer ligament on a few neighbours.
//
//   band      a patch of a solid band of height h glued to the surface, far edge fixed (small strain of the band):
//             psi = theta w/2 [ (u.n)^2 + r (|u|^2 - (u.n)^2) ],  u = x - X, n the outward normal [J]
//
//   slack     a band longer than its gap by z holds in part s like that solid and else like strings to its far edge,
//             which pull beyond h + z and never push:
//             psi = s psi_solid + (1 - s) theta w/2 <|h n - u| - h - z>^2,  s = exp(-z / 1 mm), at least 0.02 so
//             that the body never floats
//
// theta is the parameter of the tether's group (N/m for bands, a factor for springs), w the tether's share of it.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <set>
#include <vector>

#include "plugins/simulation/anchor_spring.h"
#include "plugins/simulation/block_pattern.h"
#include "plugins/simulation/spring_fan.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

struct BandPatch {
    Eigen::Vector3d rest = Eigen::Vector3d::Zero();    ///< X [m]
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< n
    double shear_ratio = 0.3;                          ///< r: tangential over normal stiffness
    double height_m = 0.02;                            ///< h
    double dead_zone_m = 0.0;                          ///< z: how much longer than h the band is when it hangs slack
};

struct Tether {
    enum class Kind { kBand, kSpring, kBar, kFan };
    Kind kind = Kind::kBand;
    NodeIndex node = 0;
    std::int32_t parameter = -1;  ///< index into theta; -1: theta = 1
    double share = 1.0;           ///< w
    BandPatch band;
    AnchorSpring spring;  ///< also anchor, rest length and k[0] of a bar
    SpringFan fan;        ///< `node` is the first of its near springs
    std::size_t num_nodes() const { return kind == Kind::kFan ? fan.near.size() : 1; }
    NodeIndex node_at(std::size_t i) const { return kind == Kind::kFan ? fan.near[i].node : node; }
};

/// Adds energy and gradient of all tethers for every lane; theta: parameter p of lane l at p * stride + l.
void add_tether_gradient(const std::vector<Tether>& tethers, const double* theta, const double* x, double* gradient,
                         double* energy, std::size_t stride, std::size_t lanes) noexcept;

/// Stiffness of one tether of a single node at theta = 1 with its node at x (3x3).
Eigen::Matrix3d tether_stiffness(const Tether& tether, const Eigen::Vector3d& x) noexcept;

/// Calls add(i, j, K_ij) for every pair of the tether's nodes (i, j: of node_at), body at x, theta = 1.
template <class Add>
void for_stiffness_blocks(const Tether& tether, const Positions& x, Add&& add) noexcept {
    if (tether.kind != Tether::Kind::kFan)
        return add(std::size_t{0}, std::size_t{0}, tether_stiffness(tether, x.col(tether.node)));
    FanStiffness fan;
    fan_stiffness(tether.fan, x, fan);
    for (std::size_t i = 0; i < tether.num_nodes(); ++i)
        for (std::size_t j = 0; j < tether.num_nodes(); ++j) add(i, j, Eigen::Matrix3d(tether.share * fan.block(i, j)));
}

/// Adds the couplings between nodes of a tether.
void couple(const std::vector<Tether>& tethers, std::vector<std::set<NodeIndex>>& neighbours);

/// Adds the tangent of one state; theta: one value per parameter.
void add_tether_tangent(const std::vector<Tether>& tethers, const double* theta, const Positions& x,
                        const BlockPattern& pattern, std::vector<double>& values) noexcept;

}  // namespace teres
