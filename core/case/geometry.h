// Small vector algebra on Point and measures of tetrahedra; core knows no Eigen.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/case/case.h"

namespace teres {

inline Point plus(const Point& a, const Point& b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Point minus(const Point& a, const Point& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Point times(double s, const Point& a) {
    return {s * a[0], s * a[1], s * a[2]};
}
inline double dot(const Point& a, const Point& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Point cross(const Point& a, const Point& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double norm(const Point& a) {
    return std::sqrt(dot(a, a));
}
inline double distance(const Point& a, const Point& b) {
    return norm(minus(a, b));
}
inline bool is_finite(const Point& a) {
    return std::isfinite(a[0]) && std::isfinite(a[1]) && std::isfinite(a[2]);
}

/// det[b - a, c - a, d - a] / 6 of tetrahedron a b c d [m^3]
inline double signed_volume_m3(const TetMeshData& mesh, std::size_t tet) {
    const auto& n = mesh.tets[tet];
    const auto node = [&](std::size_t i) -> const Point& { return mesh.nodes[static_cast<std::size_t>(n[i])]; };
    const Point ab = minus(node(1), node(0)), ac = minus(node(2), node(0)), ad = minus(node(3), node(0));
    return dot(cross(ab, ac), ad) / 6.0;
}

inline double longest_edge_m(const TetMeshData& mesh, std::size_t tet) {
    const auto& n = mesh.tets[tet];
    double longest = 0.0;
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j)
            longest = std::max(longest, distance(mesh.nodes[static_cast<std::size_t>(n[i])],
                                                 mesh.nodes[static_cast<std::size_t>(n[j])]));
    return longest;
}

}  // namespace teres
