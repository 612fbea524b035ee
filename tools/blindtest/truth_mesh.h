// The true organ as quadratic elements: ten-node tetrahedra of the body, fifteen-node wedges of bands on its surface.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "core/case/case.h"
#include "core/case/surface.h"

namespace teres::blindtest {

using NodeEdge = std::pair<std::int32_t, std::int32_t>;  ///< smaller id first
NodeEdge node_edge(std::int32_t a, std::int32_t b);

struct WedgeLayer {
    std::vector<std::vector<std::int32_t>> wedges;  ///< 15 nodes each; all layers over a triangle follow one another
    std::vector<std::int32_t> far_nodes;
    std::vector<std::int32_t> triangles;  ///< of the surface
    std::size_t layers = 0;
};

class TruthMesh {
  public:
    explicit TruthMesh(TetMeshData corners);

    const TetMeshData& corners() const { return corners_; }
    const Surface& surface() const { return surface_; }
    const std::vector<Point>& nodes() const { return nodes_; }  ///< corners, mid-edge nodes, then those of bands
    std::vector<std::vector<std::int32_t>> tets10() const;
    std::int32_t mid(std::int32_t a, std::int32_t b) const { return mid_.at(node_edge(a, b)); }
    /// Three corners, then the mid-edge nodes between 0-1, 1-2, 2-0.
    std::array<std::int32_t, 6> face_nodes(std::size_t triangle) const;
    Point centroid(std::size_t triangle) const;
    double area(std::size_t triangle) const;
    /// Triangles with these centroids; a facet keeps its centroid when a cut renumbers the surface.
    std::vector<std::int32_t> find(std::span<const Point> centroids) const;

    /// Wedges over surface triangles, `height` along the node normals.
    WedgeLayer extrude(std::span<const std::int32_t> triangles, double height_m, std::size_t layers);
    /// Opens the body between tetrahedra on both sides of a bowl d.n = bend |d - (d.n) n|^2 / 2, d = x - centre, within
    /// `radius` of `centre`: nodes of the crack that no longer hang together are doubled. Returns the number of faces
    /// opened. Call before extrude().
    std::size_t cut(const Point& centre_m, const Point& normal, double bend_1_m, double radius_m);

  private:
    void number_mid_nodes();

    TetMeshData corners_;
    Surface surface_;
    std::map<NodeEdge, std::int32_t> mid_;
    std::vector<Point> nodes_;
};

/// Where a material point lies in quadratic elements: node ids and shape values.
struct QuadraticPoint {
    std::vector<std::pair<std::int32_t, double>> weights;
};
/// Empty if the point lies in no tetrahedron (barycentric coordinates above -1e-6).
QuadraticPoint in_body(const TruthMesh& mesh, const Point& p);

/// The point of the surface that is closest to p.
QuadraticPoint on_surface(const TruthMesh& mesh, const Point& p);
/// Nodal shares of forces at points near the surface; sum that of the points' shares.
std::vector<std::pair<std::int32_t, double>> point_weights(const TruthMesh& mesh,
                                                           std::span<const std::pair<Point, double>> points);

/// Consistent nodal shares of the traction (1 - d^2/R^2)^2 about `centre` on the surface; sum 1,
/// empty where the patch misses the surface.
/// `quadratic`: on the six-node faces, else on the corners.
std::vector<std::pair<std::int32_t, double>> patch_weights(const TetMeshData& mesh, const Surface& surface,
                                                           const TruthMesh* quadratic, const Point& centre_m,
                                                           double radius_m);

}  // namespace teres::blindtest
