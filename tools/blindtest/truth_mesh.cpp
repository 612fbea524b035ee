#include "tools/blindtest/truth_mesh.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/case/geometry.h"

namespace teres::blindtest {
namespace {

// Order of the mid-edge nodes of C3D10.
constexpr std::array<std::array<std::size_t, 2>, 6> kTetEdges{{{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}};

std::size_t at(std::int32_t id) {
    return static_cast<std::size_t>(id);
}

std::array<double, 6> face_shape(const std::array<double, 3>& l) {
    return {l[0] * (2 * l[0] - 1), l[1] * (2 * l[1] - 1), l[2] * (2 * l[2] - 1),
            4 * l[0] * l[1],       4 * l[1] * l[2],       4 * l[2] * l[0]};
}

}  // namespace

NodeEdge node_edge(std::int32_t a, std::int32_t b) {
    return {std::min(a, b), std::max(a, b)};
}

TruthMesh::TruthMesh(TetMeshData corners) : corners_(std::move(corners)), surface_(corners_) {
    number_mid_nodes();
}

void TruthMesh::number_mid_nodes() {
    mid_.clear();
    nodes_ = corners_.nodes;
    for (const auto& tet : corners_.tets)
        for (const auto& [i, j] : kTetEdges) {
            const auto [found, fresh] =
                mid_.try_emplace(node_edge(tet[i], tet[j]), static_cast<std::int32_t>(nodes_.size()));
            if (fresh) nodes_.push_back(times(0.5, plus(corners_.nodes[at(tet[i])], corners_.nodes[at(tet[j])])));
        }
}

std::vector<std::vector<std::int32_t>> TruthMesh::tets10() const {
    std::vector<std::vector<std::int32_t>> elements;
    for (const auto& tet : corners_.tets) {
        std::vector<std::int32_t> ids(tet.begin(), tet.end());
        for (const auto& [i, j] : kTetEdges) ids.push_back(mid(tet[i], tet[j]));
        elements.push_back(std::move(ids));
    }
    return elements;
}

std::array<std::int32_t, 6> TruthMesh::face_nodes(std::size_t triangle) const {
    const auto& [a, b, c] = surface_.triangles()[triangle];
    return {a, b, c, mid(a, b), mid(b, c), mid(c, a)};
}

Point TruthMesh::centroid(std::size_t triangle) const {
    const auto& [a, b, c] = surface_.triangles()[triangle];
    return times(1.0 / 3.0, plus(corners_.nodes[at(a)], plus(corners_.nodes[at(b)], corners_.nodes[at(c)])));
}

double TruthMesh::area(std::size_t triangle) const {
    const auto& [a, b, c] = surface_.triangles()[triangle];
    const Point& p = corners_.nodes[at(a)];
    return 0.5 * norm(cross(minus(corners_.nodes[at(b)], p), minus(corners_.nodes[at(c)], p)));
}

std::vector<std::int32_t> TruthMesh::find(std::span<const Point> centroids) const {
    std::vector<std::int32_t> found;
    for (const Point& wanted : centroids)
        for (std::size_t t = 0; t < surface_.triangles().size(); ++t)
            if (distance(centroid(t), wanted) < 1e-9) found.push_back(static_cast<std::int32_t>(t));
    return found;
}

WedgeLayer TruthMesh::extrude(std::span<const std::int32_t> triangles, double height_m, std::size_t layers) {
    WedgeLayer band;
    band.layers = layers;
    band.triangles.assign(triangles.begin(), triangles.end());
    std::map<std::int32_t, Point> normal;
    const std::vector<Point> normals = surface_.node_normals();
    for (std::size_t i = 0; i < normals.size(); ++i) normal[surface_.nodes()[i]] = normals[i];

    // Node at half level k (0 .. 2 layers) over a corner (a == b) or over a mid-edge node.
    std::map<std::pair<NodeEdge, std::size_t>, std::int32_t> over;
    const auto above = [&](std::int32_t a, std::int32_t b, std::size_t k) {
        if (k == 0) return a == b ? a : mid(a, b);
        const auto [found, fresh] = over.try_emplace({node_edge(a, b), k}, static_cast<std::int32_t>(nodes_.size()));
        if (fresh) {
            const Point base = times(0.5, plus(corners_.nodes[at(a)], corners_.nodes[at(b)]));
            const Point up = times(0.5, plus(normal.at(a), normal.at(b)));
            nodes_.push_back(
                plus(base, times(height_m * static_cast<double>(k) / (2.0 * static_cast<double>(layers)), up)));
            if (k == 2 * layers) band.far_nodes.push_back(found->second);
        }
        return found->second;
    };
    for (const std::int32_t triangle : triangles) {
        const auto& [a, b, c] = surface_.triangles()[at(triangle)];
        for (std::size_t layer = 0; layer < layers; ++layer) {
            const std::size_t low = 2 * layer, middle = low + 1, high = low + 2;
            band.wedges.push_back({above(a, a, low), above(b, b, low), above(c, c, low), above(a, a, high),
                                   above(b, b, high), above(c, c, high), above(a, b, low), above(b, c, low),
                                   above(c, a, low), above(a, b, high), above(b, c, high), above(c, a, high),
                                   above(a, a, middle), above(b, b, middle), above(c, c, middle)});
        }
    }
    return band;
}

std::size_t TruthMesh::cut(const Point& centre_m, const Point& normal, double bend_1_m, double radius_m) {
    const std::vector<std::array<std::int32_t, 4>> tets = corners_.tets;
    const auto centroid_of = [&](const auto& ids) {
        Point sum{};
        for (const std::int32_t node : ids) sum = plus(sum, corners_.nodes[at(node)]);
        return times(1.0 / static_cast<double>(ids.size()), sum);
    };
    const auto side = [&](std::size_t tet) {
        const Point d = minus(centroid_of(tets[tet]), centre_m);
        const double beyond = dot(d, normal);
        return beyond > 0.5 * bend_1_m * (dot(d, d) - beyond * beyond);
    };

    // Pairs of tetrahedra that share a face, without those that the cut parts.
    std::map<std::array<std::int32_t, 3>, std::size_t> first;
    std::vector<std::pair<std::size_t, std::size_t>> joined;
    std::set<std::int32_t> crack;
    std::size_t opened = 0;
    for (std::size_t t = 0; t < tets.size(); ++t)
        for (std::size_t skip = 0; skip < 4; ++skip) {
            std::array<std::int32_t, 3> face{};
            for (std::size_t i = 0, k = 0; i < 4; ++i)
                if (i != skip) face[k++] = tets[t][i];
            std::sort(face.begin(), face.end());
            const auto [found, fresh] = first.try_emplace(face, t);
            if (fresh) continue;
            if (side(t) == side(found->second) || distance(centroid_of(face), centre_m) > radius_m) {
                joined.emplace_back(found->second, t);
            } else {
                crack.insert(face.begin(), face.end());
                ++opened;
            }
        }
    // A node of the crack is doubled once for every further group of tetrahedra that still hang together about it.
    for (const std::int32_t node : crack) {
        std::map<std::size_t, std::size_t> group;
        for (std::size_t t = 0; t < tets.size(); ++t)
            if (std::count(tets[t].begin(), tets[t].end(), node) != 0) group[t] = t;
        for (bool changed = true; changed;) {
            changed = false;
            for (const auto& [a, b] : joined) {
                if (group.count(a) == 0 || group.count(b) == 0 || group[a] == group[b]) continue;
                group[a] = group[b] = std::min(group[a], group[b]);
                changed = true;
            }
        }
        std::map<std::size_t, std::int32_t> name{{group.begin()->second, node}};
        for (const auto& [t, leader] : group) {
            const auto [found, fresh] = name.try_emplace(leader, static_cast<std::int32_t>(corners_.nodes.size()));
            if (fresh) corners_.nodes.push_back(Point(corners_.nodes[at(node)]));
            std::replace(corners_.tets[t].begin(), corners_.tets[t].end(), node, found->second);
        }
    }
    surface_ = Surface(corners_);
    number_mid_nodes();
    return opened;
}

QuadraticPoint in_body(const TruthMesh& mesh, const Point& p) {
    QuadraticPoint point;
    double best = -1e-6;
    for (const auto& tet : mesh.corners().tets) {
        const auto node = [&](std::size_t i) -> const Point& { return mesh.corners().nodes[at(tet[i])]; };
        const Point u = minus(node(1), node(0)), v = minus(node(2), node(0)), w = minus(node(3), node(0)),
                    q = minus(p, node(0));
        const double det = dot(u, cross(v, w));
        std::array<double, 4> l{0.0, dot(q, cross(v, w)) / det, dot(u, cross(q, w)) / det, dot(u, cross(v, q)) / det};
        l[0] = 1.0 - l[1] - l[2] - l[3];
        const double inside = *std::min_element(l.begin(), l.end());
        if (inside <= best) continue;
        best = inside;
        point.weights.clear();
        for (std::size_t i = 0; i < 4; ++i) point.weights.emplace_back(tet[i], l[i] * (2.0 * l[i] - 1.0));
        for (const auto& [i, j] : kTetEdges) point.weights.emplace_back(mesh.mid(tet[i], tet[j]), 4.0 * l[i] * l[j]);
    }
    return point;
}

QuadraticPoint on_surface(const TruthMesh& mesh, const Point& p) {
    const SurfacePoint at_p = mesh.surface().closest(p);
    const auto nodes = mesh.face_nodes(at(at_p.triangle));
    const auto shape = face_shape(at_p.barycentric);
    QuadraticPoint point;
    for (std::size_t k = 0; k < 6; ++k) point.weights.emplace_back(nodes[k], shape[k]);
    return point;
}

std::vector<std::pair<std::int32_t, double>> point_weights(const TruthMesh& mesh,
                                                           std::span<const std::pair<Point, double>> points) {
    std::map<std::int32_t, double> shares;
    for (const auto& [p, share] : points)
        for (const auto& [node, weight] : on_surface(mesh, p).weights) shares[node] += share * weight;
    return {shares.begin(), shares.end()};
}

std::vector<std::pair<std::int32_t, double>> patch_weights(const TetMeshData& mesh, const Surface& surface,
                                                           const TruthMesh* quadratic, const Point& centre_m,
                                                           double radius_m) {
    // Midpoints of the 16 equal parts of a triangle: the density is only C1, a high order would not pay.
    constexpr int kParts = 4;
    std::map<std::int32_t, double> weights;
    double total = 0.0;
    for (std::size_t t = 0; t < surface.triangles().size(); ++t) {
        const auto& corners = surface.triangles()[t];
        const Point &a = mesh.nodes[at(corners[0])], &b = mesh.nodes[at(corners[1])], &c = mesh.nodes[at(corners[2])];
        const double area = 0.5 * norm(cross(minus(b, a), minus(c, a))) / (kParts * kParts);
        for (int i = 0; i < kParts; ++i)
            for (int j = 0; j < 2 * (kParts - i) - 1; ++j) {
                const double up = j % 2 == 0 ? 1.0 / 3.0 : 2.0 / 3.0;  // centroid of an upright or upside-down part
                const double u = (i + up) / kParts, v = (j / 2 + up) / kParts;
                const std::array<double, 3> l{1.0 - u - v, u, v};
                const Point p = plus(times(l[0], a), plus(times(l[1], b), times(l[2], c)));
                const double q = 1.0 - std::pow(distance(p, centre_m) / radius_m, 2);
                if (q <= 0.0) continue;
                total += area * q * q;
                if (quadratic == nullptr) {
                    for (std::size_t k = 0; k < 3; ++k) weights[corners[k]] += area * q * q * l[k];
                } else {
                    const auto nodes = quadratic->face_nodes(t);
                    const auto shape = face_shape(l);
                    for (std::size_t k = 0; k < 6; ++k) weights[nodes[k]] += area * q * q * shape[k];
                }
            }
    }
    if (total == 0.0) return {};
    std::vector<std::pair<std::int32_t, double>> shares(weights.begin(), weights.end());
    for (auto& [node, share] : shares) share /= total;
    return shares;
}

}  // namespace teres::blindtest
