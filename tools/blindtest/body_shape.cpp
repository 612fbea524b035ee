#include "tools/blindtest/body_shape.h"

#include <algorithm>
#include <cmath>

#include "core/case/geometry.h"

namespace teres::blindtest {
namespace {
constexpr double kReach = 0.25;           // [m] no part of a liver is further from its centre
constexpr double kMargin = 0.01;          // [m] of the box
constexpr double kAdultVolume = 0.00055;  // [m3] of the drawn bodies of scale 1
}  // namespace

Point BodyShape::normal(const Point& p) const {
    constexpr double kStep = 1e-5;
    Point g{};
    for (std::size_t i = 0; i < 3; ++i) {
        Point a = p, b = p;
        a[i] -= kStep;
        b[i] += kStep;
        g[i] = level(b) - level(a);
    }
    return times(1.0 / std::max(norm(g), 1e-300), g);
}

Point BodyShape::exit(const Point& origin, const Point& direction) const {
    double inside = 0.0, outside = kReach;
    for (double r = 0.0; r < kReach; r += 0.002) {  // first crossing
        if (level(plus(origin, times(r, direction))) >= 0.0) {
            outside = r;
            break;
        }
        inside = r;
    }
    for (int i = 0; i < 40; ++i) {
        const double middle = 0.5 * (inside + outside);
        (level(plus(origin, times(middle, direction))) < 0.0 ? inside : outside) = middle;
    }
    return plus(origin, times(inside, direction));
}

MeshShape::MeshShape(const TetMeshData& mesh) : surface_(mesh), normals_(mesh.nodes.size()) {
    const std::vector<Point> at_surface = surface_.node_normals();
    for (std::size_t i = 0; i < at_surface.size(); ++i)
        normals_[static_cast<std::size_t>(surface_.nodes()[i])] = at_surface[i];
    low_ = high_ = mesh.nodes.front();
    for (const Point& p : mesh.nodes)
        for (std::size_t i = 0; i < 3; ++i) {
            low_[i] = std::min(low_[i], p[i]);
            high_[i] = std::max(high_[i], p[i]);
        }
    for (std::size_t i = 0; i < 3; ++i) {
        low_[i] -= kMargin;
        high_[i] += kMargin;
    }
    double volume = 0.0, deepest = 0.0;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
        volume += signed_volume_m3(mesh, t);
        Point c{};
        for (const std::int32_t node : mesh.tets[t])
            c = plus(c, times(0.25, mesh.nodes[static_cast<std::size_t>(node)]));
        if (const double depth = surface_.closest(c).distance_m; depth > deepest) {
            deepest = depth;
            centre_ = c;
        }
    }
    scale_ = std::cbrt(volume / kAdultVolume);
}

// The sign at an edge or a corner is that of the mean normal of the faces about it. Source: Baerentzen & Aanaes,
// "Signed distance computation using the angle weighted pseudonormal", TVCG 11(3), 2005 (theirs are weighted by angle).
double MeshShape::level(const Point& p) const {
    const SurfacePoint at = surface_.closest(p);
    const auto& corners = surface_.triangles()[static_cast<std::size_t>(at.triangle)];
    Point outward = at.normal;
    if (*std::min_element(at.barycentric.begin(), at.barycentric.end()) < 1e-9) {
        outward = {};
        for (std::size_t i = 0; i < 3; ++i)
            outward = plus(outward, times(at.barycentric[i], normals_[static_cast<std::size_t>(corners[i])]));
    }
    return dot(minus(p, at.position_m), outward) < 0.0 ? -at.distance_m : at.distance_m;
}

}  // namespace teres::blindtest
