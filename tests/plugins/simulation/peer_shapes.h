// Small tetrahedral bodies for the tests of the single-state steppers.
#pragma once

#include <Eigen/Dense>

#include "core/case/case.h"

namespace teres::test {

/// One tetrahedron, a at the origin, b on the x axis, c in the xy plane: its first-edge frame at rest is the
/// identity.
inline TetMeshData single_tet() {
    TetMeshData mesh;
    mesh.nodes = {{0.0, 0.0, 0.0}, {0.05, 0.0, 0.0}, {0.012, 0.04, 0.0}, {0.015, 0.011, 0.036}};
    mesh.tets = {{0, 1, 2, 3}};
    return mesh;
}

/// A distorted cube of six tetrahedra.
inline TetMeshData distorted_cube() {
    TetMeshData mesh;
    for (int k = 0; k < 2; ++k)
        for (int j = 0; j < 2; ++j)
            for (int i = 0; i < 2; ++i)
                mesh.nodes.push_back({0.05 * i + 0.004 * j, 0.04 * j + 0.003 * k * i, 0.06 * k + 0.002 * i * j});
    mesh.tets = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
    return mesh;
}

inline Eigen::VectorXd rest_positions(const TetMeshData& mesh) {
    Eigen::VectorXd x(3 * static_cast<Eigen::Index>(mesh.nodes.size()));
    for (std::size_t a = 0; a < mesh.nodes.size(); ++a)
        for (std::size_t c = 0; c < 3; ++c) x(static_cast<Eigen::Index>(3 * a + c)) = mesh.nodes[a][c];
    return x;
}

/// The same motion for every node: x -> R x + t.
inline Eigen::VectorXd moved(const Eigen::VectorXd& x, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
    Eigen::VectorXd out(x.size());
    for (Eigen::Index a = 0; a < x.size() / 3; ++a) out.segment<3>(3 * a) = R * x.segment<3>(3 * a) + t;
    return out;
}

/// A fixed "random" vector with entries in [-size, size].
inline Eigen::VectorXd scatter(Eigen::Index n, double size, double seed = 0.3) {
    Eigen::VectorXd out(n);
    for (Eigen::Index i = 0; i < n; ++i)
        out(i) = size * std::sin(12.9898 * (static_cast<double>(i) + seed) * (1.0 + seed));
    return out;
}

}  // namespace teres::test
