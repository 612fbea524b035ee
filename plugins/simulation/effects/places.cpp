#include "plugins/simulation/effects/places.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <set>

namespace teres {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

std::vector<std::size_t> spread(const Matrix3Xd& points, std::size_t count) {
    std::vector<std::size_t> chosen;
    if (points.cols() == 0) return chosen;
    const Vector3d mean = points.rowwise().mean();
    Eigen::VectorXd distance = (points.colwise() - mean).colwise().squaredNorm();
    while (chosen.size() < count) {
        Eigen::Index next = 0;
        if (distance.maxCoeff(&next) <= 0.0) break;
        const Eigen::VectorXd d = (points.colwise() - Vector3d(points.col(next))).colwise().squaredNorm();
        distance = chosen.empty() ? d : Eigen::VectorXd(distance.cwiseMin(d));
        chosen.push_back(static_cast<std::size_t>(next));
    }
    return chosen;
}

namespace {

constexpr double kEdge = 0.15;  // radii
constexpr double kWhole = 2.4;  // radii: inside() is 0.98 at the ends
constexpr double kReach = 2.0;  // radii: inside() is 0.001 beyond
constexpr double kPointsPerRadius = 3.0;
constexpr std::size_t kMostPatches = 2048;  // kept; some kilobytes each
constexpr int kMostParts = 16;              // of a triangle's edges

// Middles of n^2 equal parts of a triangle, n a power of two so that few triangles change theirs at a time, about
// `per_m` along an edge. visit(point, its barycentric weights, area of the part).
template <class Visit>
void visit_points(const TetMesh& mesh, const std::array<NodeIndex, 3>& triangle, double per_m, const Visit& visit) {
    const Vector3d a = mesh.X.col(triangle[0]), ab = mesh.X.col(triangle[1]) - a, ac = mesh.X.col(triangle[2]) - a;
    const double edge = std::sqrt(std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()}));
    int n = 1;
    while (n < kMostParts && n < per_m * edge) n *= 2;
    const double part = 0.5 * ab.cross(ac).norm() / (n * n);
    const auto visit_middle = [&](double i, double j) {
        visit(a + i / n * ab + j / n * ac, Vector3d(1.0 - (i + j) / n, i / n, j / n), part);
    };
    for (int i = 0; i < n; ++i)
        for (int j = 0; i + j < n; ++j) {
            visit_middle(i + 1.0 / 3.0, j + 1.0 / 3.0);
            if (i + j + 1 < n) visit_middle(i + 2.0 / 3.0, j + 2.0 / 3.0);
        }
}

std::vector<Vector3d> spread_columns(const std::vector<Vector3d>& points, std::size_t count) {
    Matrix3Xd columns(3, static_cast<Eigen::Index>(points.size()));
    for (std::size_t i = 0; i < points.size(); ++i) columns.col(static_cast<Eigen::Index>(i)) = points[i];
    std::vector<Vector3d> places;
    for (const auto i : spread(columns, count)) places.push_back(points[i]);
    return places;
}

}  // namespace

std::vector<Vector3d> surface_places(const Scene& scene, std::size_t count, bool free_only) {
    std::set<NodeIndex> tied;
    if (free_only)
        for (std::size_t t = 0; t < scene.parts.tethers.size(); ++t) tied.insert(scene.parts.tethers[t].node);
    std::vector<Vector3d> points;
    for (std::size_t i = 0; i < scene.mesh.num_nodes(); ++i)
        if (scene.mesh.node_area[i] > 0.0 && !tied.contains(static_cast<NodeIndex>(i)))
            points.emplace_back(scene.mesh.X.col(static_cast<Eigen::Index>(i)));
    return spread_columns(points, count);
}

std::vector<Vector3d> inner_places(const Scene& scene, std::size_t count) {
    std::vector<Vector3d> points;
    for (const auto& tet : scene.mesh.tets) {
        Vector3d middle = Vector3d::Zero();
        for (const auto node : tet) middle += 0.25 * scene.mesh.X.col(node);
        points.push_back(middle);
    }
    return spread_columns(points, count);
}

std::vector<Ball> ligament_places(const Scene& scene, const std::vector<double>& sizes) {
    std::vector<Ball> balls;
    std::set<std::int32_t> groups;
    for (std::size_t t = 0; t < scene.tethers.ligament_end; ++t) groups.insert(scene.parts.tethers[t].parameter);
    const auto around = [&](auto&& belongs) {
        Ball ball;
        std::set<NodeIndex> nodes;
        for (std::size_t t = 0; t < scene.tethers.ligament_end; ++t)
            if (belongs(scene.parts.tethers[t].parameter)) nodes.insert(scene.parts.tethers[t].node);
        for (const auto node : nodes) ball.centre += scene.mesh.X.col(node) / static_cast<double>(nodes.size());
        for (const auto node : nodes)
            ball.radius_m = std::max(ball.radius_m, (scene.mesh.X.col(node) - ball.centre).norm());
        if (!(ball.radius_m > 0.0)) ball.radius_m = 0.02 * scene.size_m;
        return ball;
    };
    for (const auto g : groups) {
        const Ball ball = around([&](std::int32_t p) { return p == g; });
        for (const double size : sizes) balls.push_back({ball.centre, size * ball.radius_m});
    }
    if (groups.empty()) return balls;
    const Ball whole = around([](std::int32_t) { return true; });
    balls.push_back({whole.centre, kWhole * whole.radius_m});
    return balls;
}

double inside(const Vector3d& x, const Vector3d& centre, double radius_m) {
    return inside(x, centre, radius_m, kEdge * radius_m);
}

double inside(const Vector3d& x, const Vector3d& centre, double radius_m, double edge_m) {
    return 1.0 / (1.0 + std::exp(((x - centre).norm() - radius_m) / std::min(edge_m, kEdge * radius_m)));
}

namespace {

Patch make_patch(const Scene& scene, const Vector3d& centre, double radius_m) {
    const TetMesh& mesh = scene.mesh;
    const double edge_of_ball = kReach * radius_m, reach = edge_of_ball + mesh.longest_surface_edge_m;
    std::vector<double> area(mesh.num_nodes(), 0.0);
    for (const auto& triangle : mesh.surface)
        if ((mesh.X.col(triangle[0]) - centre).squaredNorm() < reach * reach)
            visit_points(mesh, triangle, kPointsPerRadius / radius_m,
                         [&](const Vector3d& x, const Vector3d& weight, double area_m2) {
                             if ((x - centre).squaredNorm() > edge_of_ball * edge_of_ball) return;
                             const double part = area_m2 * inside(x, centre, radius_m);
                             for (std::size_t k = 0; k < 3; ++k)
                                 area[static_cast<std::size_t>(triangle[k])] +=
                                     weight(static_cast<Eigen::Index>(k)) * part;
                         });
    Patch patch;
    for (std::size_t i = 0; i < area.size(); ++i) {
        if (!(area[i] > 0.0)) continue;
        patch.node.push_back(static_cast<NodeIndex>(i));
        patch.area_m2.push_back(area[i]);
        patch.total_m2 += area[i];
    }
    if (!patch.node.empty()) return patch;
    // A place inside: the point of the surface next to it, shared by its triangle's nodes, so that what moves the place
    // is seen.
    const SurfacePoint next = scene.surface.closest({centre.x(), centre.y(), centre.z()});
    const auto& triangle = scene.surface.triangles()[static_cast<std::size_t>(next.triangle)];
    double around = 0.0;
    for (std::size_t k = 0; k < 3; ++k)
        around += next.barycentric[k] * mesh.node_area[static_cast<std::size_t>(triangle[k])];
    for (std::size_t k = 0; k < 3; ++k) {
        if (next.barycentric[k] <= 0.0) continue;
        patch.node.push_back(triangle[k]);
        patch.area_m2.push_back(next.barycentric[k] * around);
        patch.total_m2 += patch.area_m2.back();
    }
    return patch;
}

}  // namespace

const Patch& surface_patch(Scene& scene, const Vector3d& centre, double radius_m) {
    std::array<std::uint64_t, 4> key{};
    for (std::size_t k = 0; k < 3; ++k) key[k] = std::bit_cast<std::uint64_t>(centre(static_cast<Eigen::Index>(k)));
    key[3] = std::bit_cast<std::uint64_t>(radius_m);
    if (scene.patches.size() >= kMostPatches) scene.patches.clear();
    const auto [at, added] = scene.patches.try_emplace(key);
    if (added) at->second = make_patch(scene, centre, radius_m);
    return at->second;
}

double ramp(double t, double t0, double rise) {
    if (t < t0) return 0.0;
    if (t >= t0 + rise) return 1.0;
    const double s = (t - t0) / rise;
    return s * s * (3.0 - 2.0 * s);
}

std::vector<double> onset_grid(const Scene& scene, int count) {
    std::vector<double> onsets;
    for (int k = 1; k <= count; ++k) onsets.push_back(scene.start_s + (scene.end_s - scene.start_s) * k / (count + 1));
    return onsets;
}

void add_centre(std::vector<EffectParameter>& parameters, const Scene& scene) {
    constexpr const char* kName[3] = {"center_x", "center_y", "center_z"};
    for (Eigen::Index a = 0; a < 3; ++a) {
        const double low = scene.mesh.X.row(a).minCoeff(), high = scene.mesh.X.row(a).maxCoeff(),
                     margin = 0.05 * (high - low);
        parameters.push_back(shape(kName[a], "m", scene.centre(a), 0.29 * (high - low), low - margin, high + margin));
    }
}

void add_surface_centre(EffectDescription& description, const Scene& scene) {
    description.surface_centre = description.parameters.size();
    add_centre(description.parameters, scene);
}

}  // namespace teres
