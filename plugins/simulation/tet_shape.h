// Rest shape of one tetrahedron in the file's vertex order, whatever its orientation (the peer's meshes:
// order matters).
#pragma once

#include <Eigen/Core>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

struct TetShape {
    Eigen::Matrix3d edges;                 ///< b-a, c-a, d-a as columns [m]
    Eigen::Matrix<double, 3, 4> gradient;  ///< dN_i/dX, column per vertex [1/m]
    double volume = 0.0;                   ///< > 0 [m^3]
};

/// Errors (kInvalidInput): a node id outside the mesh, a flat tetrahedron.
Result<TetShape> tet_shape(const TetMeshData& mesh, std::size_t element);
/// Errors (kInvalidInput): not in (-1, 0.5).
Status check_poissons_ratio(double poissons_ratio);

}  // namespace teres
