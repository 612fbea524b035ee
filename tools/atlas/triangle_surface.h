// A closed triangle surface: reading (OBJ, STL, PLY, VTK), checks, measures and the exact closest point on
// it.
//
// Lengths in metres after `scale`; files carry no unit, so every reader is told it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/result.h"

namespace teres {

struct TriangleSurface {
    Eigen::Matrix3Xd V;                          ///< vertices in the order of the file [m]
    std::vector<std::array<std::int32_t, 3>> F;  ///< counter-clockwise seen from outside

    Eigen::Index num_vertices() const { return V.cols(); }
    Eigen::Vector3d corner(std::size_t face, int k) const { return V.col(F[face][static_cast<std::size_t>(k)]); }
};

/// metres per unit of "m", "cm" or "mm". Errors: kInvalidInput for any other word.
Result<double> unit_in_m(std::string_view unit);

/// By extension .obj .stl .ply .vtk (ASCII; STL and PLY binary too). Polygons are fanned into triangles; the
/// corners of an STL file that coincide are one vertex, in the order of their first appearance.
/// Errors (kInvalidInput): unreadable or malformed file (with line), index out of range, non-finite
/// coordinate.
Result<TriangleSurface> read_surface(const std::filesystem::path& file, double unit_m);
Status write_obj(const TriangleSurface& surface, const std::filesystem::path& file, const std::string& comment,
                 double unit_m);

/// Edge lists and what is wrong with the topology, each with a place [m].
struct SurfaceDefects {
    int num_components = 0;
    std::size_t num_border_edges = 0, num_folded_edges = 0;  ///< one triangle; more than two or flipped
    std::size_t num_holes = 0, num_unused_vertices = 0, num_degenerate = 0;
    Eigen::Vector3d border = Eigen::Vector3d::Zero(), folded = Eigen::Vector3d::Zero();
    std::vector<std::size_t> component_triangles;  ///< largest first
};
SurfaceDefects find_defects(const TriangleSurface& surface);

/// Closed, in one piece, consistently oriented, every vertex used. Turns an inside-out surface outwards.
/// Errors (kInvalidInput) name `name`, the defect and its place.
Status check_closed(TriangleSurface& surface, const std::string& name, double unit_m);

double signed_volume(const TriangleSurface& surface);             ///< > 0 if the faces look outwards [m^3]
Eigen::VectorXd vertex_areas(const TriangleSurface& surface);     ///< a third of the triangles around [m^2]
Eigen::Matrix3Xd vertex_normals(const TriangleSurface& surface);  ///< area-weighted, outward
Eigen::Vector3d area_centroid(const TriangleSurface& surface);

struct ClosestPoint {
    std::size_t face = 0;
    Eigen::Vector3d barycentric = Eigen::Vector3d::Zero();
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    double distance = 0.0;
};

/// Index of the nearest of some points that stay alive and unchanged.
class NearestPoint {
  public:
    explicit NearestPoint(const Eigen::Matrix3Xd& points);
    ~NearestPoint();
    Eigen::Index operator()(const Eigen::Vector3d& query) const;

  private:
    friend class ClosestPointSearch;
    struct Tree;
    std::unique_ptr<Tree> tree_;
};

/// Exact closest point on a surface that stays alive and unchanged.
class ClosestPointSearch {
  public:
    explicit ClosestPointSearch(const TriangleSurface& surface);
    ClosestPoint closest(const Eigen::Vector3d& query) const;
    /// Two triangles without a common vertex that cut each other.
    std::optional<std::pair<std::size_t, std::size_t>> self_intersection() const;

  private:
    const TriangleSurface& surface_;
    Eigen::Matrix3Xd centre_;      // of the triangles
    double largest_radius_ = 0.0;  // centre to corner
    NearestPoint near_;
};

/// The surface with about `num_vertices` vertices: shortest edges are collapsed first.
TriangleSurface simplified(const TriangleSurface& surface, Eigen::Index num_vertices);

/// Closes border loops of at most `max_edges` edges by a fan around their middle; returns how many were
/// closed.
std::size_t fill_small_holes(TriangleSurface& surface, std::size_t max_edges);

/// Distance from a point to a segment.
double segment_distance(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b);

/// "(12.0, -3.5, 80.1) mm": a place in the unit of the file.
std::string place_text(const Eigen::Vector3d& place_m, double unit_m);

}  // namespace teres
