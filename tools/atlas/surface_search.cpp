#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <nanoflann.hpp>

#include "tools/atlas/triangle_surface.h"

namespace teres {

using Eigen::Vector3d;

namespace {

// Ericson, Real-Time Collision Detection, section 5.1.5: regions of the triangle's Voronoi diagram.
Vector3d closest_barycentric(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    const Vector3d ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
    const double d1 = ab.dot(ap), d2 = ac.dot(ap), d3 = ab.dot(bp), d4 = ac.dot(bp), d5 = ab.dot(cp), d6 = ac.dot(cp);
    if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
    if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
    if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
    const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0};
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)};
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0.0, 1.0 - w, w};
    }
    return Vector3d(va, vb, vc) / (va + vb + vc);
}

}  // namespace

struct NearestPoint::Tree {
    const Eigen::Matrix3Xd& points;
    std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(points.cols()); }
    double kdtree_get_pt(std::size_t i, std::size_t k) const {
        return points(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(i));
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
    using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Tree>, Tree, 3, std::size_t>;
    std::unique_ptr<Index> index;
};

NearestPoint::NearestPoint(const Eigen::Matrix3Xd& points) : tree_(new Tree{points, nullptr}) {
    tree_->index = std::make_unique<Tree::Index>(3, *tree_, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    tree_->index->buildIndex();
}

NearestPoint::~NearestPoint() = default;

Eigen::Index NearestPoint::operator()(const Vector3d& query) const {
    std::size_t index = 0;
    double squared = 0.0;
    tree_->index->knnSearch(query.data(), 1, &index, &squared);
    return static_cast<Eigen::Index>(index);
}

namespace {

Eigen::Matrix3Xd triangle_centres(const TriangleSurface& s) {
    Eigen::Matrix3Xd centre(3, static_cast<Eigen::Index>(s.F.size()));
    for (std::size_t f = 0; f < s.F.size(); ++f)
        centre.col(static_cast<Eigen::Index>(f)) = (s.corner(f, 0) + s.corner(f, 1) + s.corner(f, 2)) / 3.0;
    return centre;
}

}  // namespace

ClosestPointSearch::ClosestPointSearch(const TriangleSurface& surface)
    : surface_(surface), centre_(triangle_centres(surface)), near_(centre_) {
    for (std::size_t f = 0; f < surface.F.size(); ++f)
        for (int k = 0; k < 3; ++k)
            largest_radius_ =
                std::max(largest_radius_, (surface.corner(f, k) - centre_.col(static_cast<Eigen::Index>(f))).norm());
}

ClosestPoint ClosestPointSearch::closest(const Vector3d& query) const {
    ClosestPoint best;
    best.distance = std::numeric_limits<double>::infinity();
    const auto look_at = [&](std::size_t f) {
        const Vector3d a = surface_.corner(f, 0), b = surface_.corner(f, 1), c = surface_.corner(f, 2);
        const Vector3d w = closest_barycentric(query, a, b, c);
        const Vector3d p = w[0] * a + w[1] * b + w[2] * c;
        const double d = (p - query).norm();
        if (d < best.distance) best = {f, w, p, d};
    };
    constexpr std::size_t kFirst = 8;
    std::array<std::size_t, kFirst> near{};
    std::array<double, kFirst> squared{};
    const std::size_t found = near_.tree_->index->knnSearch(query.data(), kFirst, near.data(), squared.data());
    for (std::size_t i = 0; i < found; ++i) look_at(near[i]);
    // A closer triangle has its centre within best + radius; most often the first eight already reach that
    // far.
    const double reach = best.distance + largest_radius_;
    if (found == kFirst && squared[kFirst - 1] < reach * reach) {
        std::vector<std::pair<std::size_t, double>> more;
        near_.tree_->index->radiusSearch(query.data(), reach * reach, more, nanoflann::SearchParams(32, 0.0F, false));
        for (const auto& [f, d] : more) look_at(f);
    }
    return best;
}

namespace {

// Does segment pq cross the inside of triangle abc? Signs of tetrahedra; touching does not count.
bool crosses(const Vector3d& p, const Vector3d& q, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    const auto side = [](const Vector3d& u, const Vector3d& v, const Vector3d& w, const Vector3d& x) {
        return (v - u).cross(w - u).dot(x - u);
    };
    if (side(a, b, c, p) * side(a, b, c, q) >= 0.0) return false;
    const double s = side(p, q, a, b), t = side(p, q, b, c), u = side(p, q, c, a);
    return (s > 0.0 && t > 0.0 && u > 0.0) || (s < 0.0 && t < 0.0 && u < 0.0);
}

}  // namespace

std::optional<std::pair<std::size_t, std::size_t>> ClosestPointSearch::self_intersection() const {
    const TriangleSurface& s = surface_;
    for (std::size_t f = 0; f < s.F.size(); ++f) {
        const Vector3d c = centre_.col(static_cast<Eigen::Index>(f));
        double radius = 0.0;
        for (int k = 0; k < 3; ++k) radius = std::max(radius, (s.corner(f, k) - c).norm());
        const double reach = radius + largest_radius_;
        std::vector<std::pair<std::size_t, double>> near;
        near_.tree_->index->radiusSearch(c.data(), reach * reach, near, nanoflann::SearchParams(32, 0.0F, false));
        for (const auto& [g, squared] : near) {
            const bool touch = std::any_of(s.F[f].begin(), s.F[f].end(), [&, g = g](auto v) {
                return std::find(s.F[g].begin(), s.F[g].end(), v) != s.F[g].end();
            });
            if (g == f || touch) continue;
            for (int k = 0; k < 3; ++k)
                if (crosses(s.corner(f, k), s.corner(f, (k + 1) % 3), s.corner(g, 0), s.corner(g, 1), s.corner(g, 2)))
                    return std::pair{f, g};
        }
    }
    return std::nullopt;
}

double segment_distance(const Vector3d& p, const Vector3d& a, const Vector3d& b) {
    const Vector3d ab = b - a;
    const double length = ab.squaredNorm();
    const double s = length > 0.0 ? std::clamp((p - a).dot(ab) / length, 0.0, 1.0) : 0.0;
    return (p - a - s * ab).norm();
}

}  // namespace teres
