// Where the strain energy is evaluated: points with a deformation gradient F = sum_i x_i (dN_i/dX)^T over a
// few nodes.
//
//   element points    one per linear tetrahedron (plain linear elements: they lock when nu -> 0.5)
//   nodal points      one per node; F is the volume average over the adjacent tetrahedra
//   quadratic points  four Gauss points per 10-node tetrahedron (reference; mid-edge nodes are added)
//
// Remedy against volumetric locking: the volume part of the energy lives on nodal points, the shear part is
// shared between element points (weight beta) and nodal points (1 - beta). A homogeneous F is reproduced
// exactly by both, so the patch test holds for every beta. Bonet & Burton 1998 (averaged nodal pressure);
// Dohrmann et al. 2000 (nodal strain); Gee, Dohrmann, Key, Wall 2009 (stabilised uniform nodal strain).
#pragma once

#include <cstdint>
#include <vector>

#include "plugins/simulation/material.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

struct StrainPoints {
    PartWeights part;  ///< share of the energy that these points carry
    std::vector<std::int32_t>
        point_of_node;                    ///< nodal averages: -1 for nodes without tissue; empty: points of elements
    std::vector<std::int32_t> offset;     ///< num_points + 1
    std::vector<NodeIndex> node;          ///< nodes of each point, ascending
    std::vector<double> gradient;         ///< dN/dX, 3 per node entry [1/m]
    std::vector<double> volume;           ///< reference volume [m^3]
    std::vector<double> stiffness_scale;  ///< multiplies the energy density; 1 is the nominal body
    /// Stiffening of sets that carry shear alone: psi (1 + beta psi / (2 mu)), beta [-]; 0 is the nominal
    /// law.
    double stiffening = 0.0;
    /// Second Piola-Kirchhoff stress of the past (viscosity), 6 per point: xx yy zz xy xz yz [Pa]; empty:
    /// none. Adds S0 : E to the energy density.
    std::vector<double> prestress;

    std::size_t size() const { return volume.size(); }
};

enum class ElementType {
    kLinear,       ///< plain linear tetrahedra
    kNodalVolume,  ///< volume part on nodal points, shear part on elements
    kNodalBlend,   ///< volume part on nodal points, shear part shared
    kQuadratic,    ///< 10-node tetrahedra
};

/// All strain points of a body.
std::vector<StrainPoints> make_strain_points(const TetMesh& mesh, ElementType type, double shear_blend);
/// The same energy on sets that carry either shear or volume alone: effects change one of them.
std::vector<StrainPoints> separate_parts(std::vector<StrainPoints> points);

/// [loop] The same points after tetrahedra of `mesh` have lost their volume (sets of element or nodal points): layout
/// stays, points without tissue get volume 0.
void follow_volumes(const TetMesh& mesh, std::vector<StrainPoints>& points) noexcept;

/// Linear tetrahedra made quadratic: straight edges, one new node in the middle of each edge (after the
/// corner nodes).
struct QuadraticMesh {
    Positions X;
    std::vector<std::array<NodeIndex, 10>> tets;
    std::vector<std::array<NodeIndex, 2>> edge;  ///< corner nodes of mid node num_corners + i
};
QuadraticMesh make_quadratic(const TetMesh& mesh);

}  // namespace teres
