#include "plugins/simulation/tet_shape.h"

#include <Eigen/LU>
#include <cmath>
#include <string>

namespace teres {

Result<TetShape> tet_shape(const TetMeshData& mesh, std::size_t element) {
    const auto& tet = mesh.tets[element];
    for (const auto node : tet)
        if (node < 0 || static_cast<std::size_t>(node) >= mesh.nodes.size())
            return invalid_input("tetrahedron " + std::to_string(element) + ": node " + std::to_string(node) +
                                 " is not in [0, " + std::to_string(mesh.nodes.size()) + ")");
    const auto point = [&](std::size_t i) {
        const auto& p = mesh.nodes[static_cast<std::size_t>(tet[i])];
        return Eigen::Vector3d(p[0], p[1], p[2]);
    };
    TetShape shape;
    for (std::size_t i = 1; i < 4; ++i) shape.edges.col(static_cast<Eigen::Index>(i) - 1) = point(i) - point(0);
    const double determinant = shape.edges.determinant();
    shape.volume = std::abs(determinant) / 6.0;
    const double size = shape.edges.colwise().norm().maxCoeff();
    // Flat: the volume is below rounding of a cube of the same size.
    if (!(shape.volume > 1e-12 * size * size * size))
        return invalid_input("tetrahedron " + std::to_string(element) + " is degenerate: volume " +
                             std::to_string(shape.volume) + " m^3");
    shape.gradient.rightCols<3>() = shape.edges.inverse().transpose();
    shape.gradient.col(0) = -shape.gradient.rightCols<3>().rowwise().sum();
    return shape;
}

Status check_poissons_ratio(double poissons_ratio) {
    if (!(poissons_ratio > -1.0 && poissons_ratio < 0.5))
        return invalid_input("poissons_ratio " + std::to_string(poissons_ratio) + " is not in (-1, 0.5)");
    return {};
}

}  // namespace teres
