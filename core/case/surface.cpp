#include "core/case/surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/case/geometry.h"
#include "core/check.h"

namespace teres {
namespace {

constexpr std::size_t kGridAbove = 20000;  // triangles; below, a whole search takes less than a millisecond

}  // namespace

// By Voronoi regions of vertices, edges and face (C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
std::array<double, 3> closest_barycentric(const Point& p, const Point& a, const Point& b, const Point& c) {
    const Point ab = minus(b, a), ac = minus(c, a), ap = minus(p, a);
    const double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
    const Point bp = minus(p, b);
    const double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        const double v = d1 / (d1 - d3);
        return {1.0 - v, v, 0.0};
    }
    const Point cp = minus(p, c);
    const double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        const double w = d2 / (d2 - d6);
        return {1.0 - w, 0.0, w};
    }
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && (d4 - d3) >= 0.0 && (d5 - d6) >= 0.0) {
        const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0.0, 1.0 - w, w};
    }
    const double sum = va + vb + vc;
    return {va / sum, vb / sum, vc / sum};
}

Surface::Surface(const TetMeshData& mesh) : positions_(mesh.nodes) {
    struct Face {
        std::array<std::int32_t, 3> key;
        std::array<std::int32_t, 3> oriented;
    };
    std::vector<Face> faces;
    faces.reserve(4 * mesh.tets.size());
    for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
        auto [a, b, c, d] = mesh.tets[tet];
        if (signed_volume_m3(mesh, tet) < 0.0) std::swap(c, d);
        // with det[b-a, c-a, d-a] > 0 these four face outward
        for (const std::array<std::int32_t, 3>& face :
             {std::array{a, c, b}, std::array{a, b, d}, std::array{a, d, c}, std::array{b, c, d}}) {
            Face f{face, face};
            std::sort(f.key.begin(), f.key.end());
            faces.push_back(f);
        }
    }
    std::stable_sort(faces.begin(), faces.end(), [](const Face& x, const Face& y) { return x.key < y.key; });
    for (std::size_t i = 0; i < faces.size();) {
        std::size_t next = i + 1;
        while (next < faces.size() && faces[next].key == faces[i].key) ++next;
        if (next == i + 1) triangles_.push_back(faces[i].oriented);
        i = next;
    }
    for (const auto& triangle : triangles_) nodes_.insert(nodes_.end(), triangle.begin(), triangle.end());
    std::sort(nodes_.begin(), nodes_.end());
    nodes_.erase(std::unique(nodes_.begin(), nodes_.end()), nodes_.end());
    if (triangles_.size() > kGridAbove) build_grid();
}

std::vector<Point> Surface::node_normals() const {
    std::vector<Point> at_node(positions_.size(), Point{});
    for (const auto& [a, b, c] : triangles_) {
        const auto& A = positions_[static_cast<std::size_t>(a)];
        const Point n = cross(minus(positions_[static_cast<std::size_t>(b)], A),
                              minus(positions_[static_cast<std::size_t>(c)], A));  // twice the area long
        for (const std::int32_t id : {a, b, c})
            at_node[static_cast<std::size_t>(id)] = plus(at_node[static_cast<std::size_t>(id)], n);
    }
    std::vector<Point> normals;
    normals.reserve(nodes_.size());
    for (const std::int32_t id : nodes_) {
        const Point& n = at_node[static_cast<std::size_t>(id)];
        const double length = norm(n);
        normals.push_back(length > 0.0 ? times(1.0 / length, n) : Point{});
    }
    return normals;
}

void Surface::try_triangle(std::size_t triangle, const Point& query_m, SurfacePoint& best) const {
    const auto& [ia, ib, ic] = triangles_[triangle];
    const Point &a = positions_[static_cast<std::size_t>(ia)], &b = positions_[static_cast<std::size_t>(ib)],
                &c = positions_[static_cast<std::size_t>(ic)];
    const std::array<double, 3> w = closest_barycentric(query_m, a, b, c);
    const Point position = plus(plus(times(w[0], a), times(w[1], b)), times(w[2], c));
    const double distance_m = distance(query_m, position);
    const auto index = static_cast<std::int32_t>(triangle);
    // ties go to the lower index, so that the grid gives the same answer as the whole search
    if (distance_m > best.distance_m || (distance_m == best.distance_m && index > best.triangle)) return;
    best.triangle = index;
    best.barycentric = w;
    best.position_m = position;
    best.distance_m = distance_m;
}

void Surface::build_grid() {
    Point low = positions_[static_cast<std::size_t>(nodes_.front())], high = low;
    for (const std::int32_t id : nodes_)
        for (std::size_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], positions_[static_cast<std::size_t>(id)][k]);
            high[k] = std::max(high[k], positions_[static_cast<std::size_t>(id)][k]);
        }
    const double extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
    // a closed surface crosses about 6 n^2 of n^3 cells: about four triangles in each
    const double cells = std::clamp(std::sqrt(static_cast<double>(triangles_.size()) / 24.0), 1.0, 128.0);
    cell_m_ = extent / cells;
    grid_origin_ = low;
    std::size_t total = 1;
    for (std::size_t k = 0; k < 3; ++k) {
        grid_size_[k] = 1 + static_cast<int>((high[k] - low[k]) / cell_m_);
        total *= static_cast<std::size_t>(grid_size_[k]);
    }
    grid_.resize(total);
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
        std::array<int, 3> first{}, last{};
        for (std::size_t k = 0; k < 3; ++k) {
            double lo = std::numeric_limits<double>::max(), hi = std::numeric_limits<double>::lowest();
            for (const std::int32_t id : triangles_[t]) {
                lo = std::min(lo, positions_[static_cast<std::size_t>(id)][k]);
                hi = std::max(hi, positions_[static_cast<std::size_t>(id)][k]);
            }
            first[k] = std::clamp(static_cast<int>((lo - low[k]) / cell_m_), 0, grid_size_[k] - 1);
            last[k] = std::clamp(static_cast<int>((hi - low[k]) / cell_m_), 0, grid_size_[k] - 1);
        }
        for (int z = first[2]; z <= last[2]; ++z)
            for (int y = first[1]; y <= last[1]; ++y)
                for (int x = first[0]; x <= last[0]; ++x)
                    grid_[static_cast<std::size_t>((z * grid_size_[1] + y) * grid_size_[0] + x)].push_back(
                        static_cast<std::int32_t>(t));
    }
}

SurfacePoint Surface::closest(const Point& query_m) const {
    TERES_CHECK(!triangles_.empty());
    SurfacePoint best;
    best.distance_m = std::numeric_limits<double>::infinity();
    if (grid_.empty()) {
        for (std::size_t t = 0; t < triangles_.size(); ++t) try_triangle(t, query_m, best);
    } else {
        // Shells of cells around the query's cell (clamped into the grid). A shell at radius r holds nothing
        // closer than (r - 1) cells, measured from the clamped query.
        std::array<int, 3> center{};
        int max_radius = 0;
        double outside2 = 0.0;  // squared distance from the query to the grid's box
        for (std::size_t k = 0; k < 3; ++k) {
            const double high = grid_origin_[k] + cell_m_ * grid_size_[k];
            const double inside = std::clamp(query_m[k], grid_origin_[k], high);
            outside2 += (query_m[k] - inside) * (query_m[k] - inside);
            center[k] = std::clamp(static_cast<int>((inside - grid_origin_[k]) / cell_m_), 0, grid_size_[k] - 1);
            max_radius = std::max(max_radius, grid_size_[k]);
        }
        for (int r = 0; r <= max_radius; ++r) {
            // the box is convex: |query - x|^2 >= |query - clamped|^2 + |clamped - x|^2 for x inside it
            const double nearest = (r - 1) * cell_m_;
            if (r > 0 && best.distance_m * best.distance_m < outside2 + nearest * std::max(nearest, 0.0)) break;
            for (int z = std::max(center[2] - r, 0); z <= std::min(center[2] + r, grid_size_[2] - 1); ++z)
                for (int y = std::max(center[1] - r, 0); y <= std::min(center[1] + r, grid_size_[1] - 1); ++y)
                    for (int x = std::max(center[0] - r, 0); x <= std::min(center[0] + r, grid_size_[0] - 1); ++x) {
                        const int ring =
                            std::max({std::abs(x - center[0]), std::abs(y - center[1]), std::abs(z - center[2])});
                        if (ring != r) continue;
                        for (const std::int32_t t :
                             grid_[static_cast<std::size_t>((z * grid_size_[1] + y) * grid_size_[0] + x)])
                            try_triangle(static_cast<std::size_t>(t), query_m, best);
                    }
        }
    }
    const auto& [a, b, c] = triangles_[static_cast<std::size_t>(best.triangle)];
    const Point& A = positions_[static_cast<std::size_t>(a)];
    const Point n =
        cross(minus(positions_[static_cast<std::size_t>(b)], A), minus(positions_[static_cast<std::size_t>(c)], A));
    best.normal = times(1.0 / norm(n), n);
    return best;
}

}  // namespace teres
