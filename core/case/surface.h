// Boundary of a tetrahedral mesh: triangles with outward orientation, and the closest point on them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/case/case.h"

namespace teres {

struct SurfacePoint {
    std::int32_t triangle = -1;           ///< index into triangles()
    std::array<double, 3> barycentric{};  ///< weights of the triangle's nodes, sum 1
    Point position_m{};
    Point normal{};           ///< outward unit normal of the triangle
    double distance_m = 0.0;  ///< from the query to position_m
};

/// Weights of a, b, c, sum 1, of the point of the triangle that is closest to p.
std::array<double, 3> closest_barycentric(const Point& p, const Point& a, const Point& b, const Point& c);

class Surface {
  public:
    /// Faces that belong to exactly one tetrahedron. Orientation is outward whatever the tetrahedron's order.
    explicit Surface(const TetMeshData& mesh);

    /// Node ids, counter-clockwise seen from outside.
    const std::vector<std::array<std::int32_t, 3>>& triangles() const { return triangles_; }
    /// Sorted ids of the nodes on the surface.
    const std::vector<std::int32_t>& nodes() const { return nodes_; }
    /// Area-weighted outward unit normal at each node of nodes(), at rest.
    std::vector<Point> node_normals() const;
    /// Closest point at rest. The surface must have triangles (a checked mesh always has).
    SurfacePoint closest(const Point& query_m) const;

  private:
    void build_grid();
    void try_triangle(std::size_t triangle, const Point& query_m, SurfacePoint& best) const;

    std::vector<Point> positions_;  // all nodes of the mesh
    std::vector<std::array<std::int32_t, 3>> triangles_;
    std::vector<std::int32_t> nodes_;

    // Uniform grid of triangle boxes; empty for small surfaces, which are searched whole.
    Point grid_origin_{};
    double cell_m_ = 0.0;
    std::array<int, 3> grid_size_{};
    std::vector<std::vector<std::int32_t>> grid_;
};

}  // namespace teres
