// The rest mesh of the body: linear tetrahedra, their volumes and shape gradients, the surface.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

using NodeIndex = std::int32_t;
using Positions = Eigen::Matrix3Xd;  ///< column per node [m]

struct TetMesh {
    Positions X;                                        ///< rest positions, 3 x N [m]
    std::vector<std::array<NodeIndex, 4>> tets;         ///< positive orientation
    std::vector<double> volume;                         ///< per tetrahedron [m^3]
    std::vector<Eigen::Matrix<double, 3, 4>> gradient;  ///< dN_i/dX, column per vertex [1/m]
    std::vector<double> node_volume;                    ///< a quarter of each adjacent tetrahedron [m^3]
    std::vector<std::array<NodeIndex, 3>> surface;      ///< boundary triangles, outward orientation
    Positions node_normal;                              ///< outward, area-weighted, unit length on the surface, else 0
    std::vector<double> node_area;                      ///< a third of each adjacent surface triangle [m^2]
    double longest_surface_edge_m = 0.0;

    std::size_t num_nodes() const { return static_cast<std::size_t>(X.cols()); }

    /// Errors (kInvalidInput): a tetrahedron that is inverted or degenerate.
    static Result<TetMesh> make(const TetMeshData& data);
};

/// Barycentric position in a tetrahedron; weights sum to 1 and are negative outside.
struct Embedding {
    std::array<NodeIndex, 4> node{};
    std::array<double, 4> weight{};
};

/// The tetrahedron that contains the point, or the nearest one (weights then extrapolate).
Embedding embed(const TetMesh& mesh, const Eigen::Vector3d& point);

/// A marker rides rigidly on its nearest surface triangle: foot point in the triangle's plane plus an offset
/// along the normal, x = sum_i w_i x_i + offset n(x).
struct SurfaceRider {
    std::array<NodeIndex, 3> node{};
    std::array<double, 3> weight{};
    double offset_m = 0.0;
};
SurfaceRider ride(const TetMesh& mesh, const Eigen::Vector3d& point);

}  // namespace teres
