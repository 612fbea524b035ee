// A box of tetrahedra: nx x ny x nz bricks, six tetrahedra each (Kuhn's subdivision: conforming, all
// diagonals alike).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/case/case.h"

namespace teres::test {

inline TetMeshData box_mesh(const Point& size_m, int nx, int ny, int nz, const Point& origin_m = {}) {
    TetMeshData mesh;
    const auto id = [&](int i, int j, int k) { return static_cast<std::int32_t>((k * (ny + 1) + j) * (nx + 1) + i); };
    for (int k = 0; k <= nz; ++k) {
        for (int j = 0; j <= ny; ++j) {
            for (int i = 0; i <= nx; ++i) {
                mesh.nodes.push_back({origin_m[0] + size_m[0] * i / nx, origin_m[1] + size_m[1] * j / ny,
                                      origin_m[2] + size_m[2] * k / nz});
            }
        }
    }
    for (int k = 0; k < nz; ++k) {
        for (int j = 0; j < ny; ++j) {
            for (int i = 0; i < nx; ++i) {
                std::array<int, 3> axes{0, 1, 2};
                int sign = 1;
                do {  // one tetrahedron per order in which the axes are walked from (0,0,0) to (1,1,1)
                    std::array<int, 3> at{i, j, k};
                    std::array<std::int32_t, 4> tet{id(i, j, k)};
                    for (int step = 0; step < 3; ++step) {
                        ++at[static_cast<std::size_t>(axes[static_cast<std::size_t>(step)])];
                        tet[static_cast<std::size_t>(step) + 1] = id(at[0], at[1], at[2]);
                    }
                    sign = ((axes[0] > axes[1]) + (axes[0] > axes[2]) + (axes[1] > axes[2])) % 2 == 0 ? 1 : -1;
                    if (sign < 0) std::swap(tet[2], tet[3]);
                    mesh.tets.push_back(tet);
                } while (std::next_permutation(axes.begin(), axes.end()));
            }
        }
    }
    return mesh;
}

/// Nodes with coordinate `axis` equal to `value`.
inline std::vector<std::int32_t> nodes_on_plane(const TetMeshData& mesh, int axis, double value) {
    std::vector<std::int32_t> ids;
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i) {
        if (std::abs(mesh.nodes[i][static_cast<std::size_t>(axis)] - value) < 1e-9) {
            ids.push_back(static_cast<std::int32_t>(i));
        }
    }
    return ids;
}

/// Boundary faces with all three nodes on the plane.
inline std::vector<std::array<std::int32_t, 3>> faces_on_plane(const TetMeshData& mesh, int axis, double value) {
    std::vector<char> on(mesh.nodes.size(), 0);
    for (const std::int32_t id : nodes_on_plane(mesh, axis, value)) on[static_cast<std::size_t>(id)] = 1;
    std::vector<std::array<std::int32_t, 3>> faces;
    for (const auto& tet : mesh.tets) {
        std::array<std::int32_t, 3> face{};
        std::size_t count = 0;
        for (const std::int32_t node : tet) {
            if (on[static_cast<std::size_t>(node)] != 0 && count < 3) face[count++] = node;
        }
        if (count == 3) faces.push_back(face);
    }
    return faces;
}

}  // namespace teres::test
