#include "tools/blindtest/lattice_mesher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "core/case/surface.h"

namespace teres::blindtest {
namespace {

using Tet = std::array<std::int32_t, 4>;
using Edge = std::pair<std::int32_t, std::int32_t>;
using Level = std::function<double(const Point&)>;

// A node is snapped to a cut nearer than this share of the edge (Labelle & Shewchuk, table 2).
constexpr double kSnapLong = 0.24999, kSnapShort = 0.41189;

Edge sorted_edge(std::int32_t a, std::int32_t b) {
    return {std::min(a, b), std::max(a, b)};
}

Point rotated(const Point& p, const Point& axis, double angle) {  // Rodrigues
    const double c = std::cos(angle), s = std::sin(angle);
    return plus(plus(times(c, p), times(s, cross(axis, p))), times((1.0 - c) * dot(axis, p), axis));
}

// The body-centred lattice about the box: corners and centres of cubes; four tetrahedra about each pair of
// neighbouring centres.
TetMeshData lattice(const LatticeOptions& o) {
    TetMeshData mesh;
    const Point middle = times(0.5, plus(o.low_m, o.high_m));
    const int half = static_cast<int>(std::ceil(0.5 * distance(o.low_m, o.high_m) / o.cell_m)) + 1;
    const int n = 2 * half + 1;  // corners per axis
    const auto corner = [&](int i, int j, int k) { return static_cast<std::int32_t>((k * n + j) * n + i); };
    const auto centre = [&](int i, int j, int k) {
        return static_cast<std::int32_t>(n * n * n + (k * (n - 1) + j) * (n - 1) + i);
    };
    const auto add = [&](double i, double j, double k) {
        const Point local{(i - half) * o.cell_m, (j - half) * o.cell_m, (k - half) * o.cell_m};
        mesh.nodes.push_back(plus(middle, rotated(local, o.axis, o.angle_rad)));
    };
    for (int k = 0; k < n; ++k)
        for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i) add(i, j, k);
    for (int k = 0; k + 1 < n; ++k)
        for (int j = 0; j + 1 < n; ++j)
            for (int i = 0; i + 1 < n; ++i) add(i + 0.5, j + 0.5, k + 0.5);
    for (int k = 0; k + 1 < n; ++k)
        for (int j = 0; j + 1 < n; ++j)
            for (int i = 0; i + 1 < n; ++i)
                for (int axis = 0; axis < 3; ++axis) {
                    std::array<int, 3> next{i, j, k};
                    ++next[static_cast<std::size_t>(axis)];
                    if (next[static_cast<std::size_t>(axis)] + 1 >= n) continue;
                    const std::size_t u = static_cast<std::size_t>(axis + 1) % 3, v = (u + 1) % 3;
                    std::array<std::int32_t, 4> ring{};  // the shared face, in order
                    const std::array<std::array<int, 2>, 4> steps{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
                    for (std::size_t r = 0; r < 4; ++r) {
                        std::array<int, 3> at = next;
                        at[u] += steps[r][0];
                        at[v] += steps[r][1];
                        ring[r] = corner(at[0], at[1], at[2]);
                    }
                    for (std::size_t r = 0; r < 4; ++r)
                        mesh.tets.push_back(
                            {centre(i, j, k), centre(next[0], next[1], next[2]), ring[r], ring[(r + 1) % 4]});
                }
    return mesh;
}

// Keeps the inner part of lattice tetrahedra; cut nodes are made once per edge.
class Clipper {
  public:
    Clipper(const Level& level, TetMeshData lattice) : level_(level), in_(std::move(lattice)) {
        for (const Point& p : in_.nodes) value_.push_back(level_(p));
        snap();
    }

    std::vector<Tet> clip() {
        std::vector<Tet> kept;
        for (const Tet& tet : in_.tets) {
            std::vector<std::int32_t> inner, on, outer;
            for (const std::int32_t node : tet) {
                const double value = value_[static_cast<std::size_t>(node)];
                (value < 0.0 ? inner : value > 0.0 ? outer : on).push_back(node);
            }
            if (inner.empty()) continue;
            const auto c = [&](std::size_t i, std::size_t o) { return cut(inner[i], outer[o]); };
            const std::size_t shape = 10 * outer.size() + on.size();
            switch (shape) {
                case 0:
                case 1:
                case 2:
                case 3:
                    kept.push_back(tet);
                    break;
                case 10:
                    add_prism({inner[0], inner[1], inner[2]}, {c(0, 0), c(1, 0), c(2, 0)}, kept);
                    break;
                case 11:
                    add_pyramid({inner[0], inner[1], c(1, 0), c(0, 0)}, on[0], kept);
                    break;
                case 12:
                    kept.push_back({inner[0], on[0], on[1], c(0, 0)});
                    break;
                case 20:
                    add_prism({inner[0], c(0, 0), c(0, 1)}, {inner[1], c(1, 0), c(1, 1)}, kept);
                    break;
                case 21:
                    kept.push_back({inner[0], on[0], c(0, 0), c(0, 1)});
                    break;
                default:
                    kept.push_back({inner[0], c(0, 0), c(0, 1), c(0, 2)});
                    break;  // 30
            }
        }
        return kept;
    }
    const std::vector<Point>& nodes() const { return in_.nodes; }

  private:
    // Share of the way from the inner end a to the outer end b at which the level is zero.
    double crossing(const Point& a, const Point& b) const {
        double low = 0.0, high = 1.0;
        for (int i = 0; i < 40; ++i) {
            const double middle = 0.5 * (low + high);
            (level_(plus(a, times(middle, minus(b, a)))) < 0.0 ? low : high) = middle;
        }
        return 0.5 * (low + high);
    }

    void snap() {
        std::set<Edge> edges;
        double shortest = 1e9;
        for (const Tet& tet : in_.tets)
            for (std::size_t i = 0; i < 4; ++i)
                for (std::size_t j = i + 1; j < 4; ++j) edges.insert(sorted_edge(tet[i], tet[j]));
        for (const auto& [a, b] : edges) shortest = std::min(shortest, distance(node(a), node(b)));
        const std::vector<Point> lattice = in_.nodes;
        std::vector<double> nearest(lattice.size(), 1e9);
        for (const auto& [a, b] : edges) {
            const double va = value_[static_cast<std::size_t>(a)], vb = value_[static_cast<std::size_t>(b)];
            if ((va < 0.0) == (vb < 0.0)) continue;
            const Point &pa = lattice[static_cast<std::size_t>(a)], &pb = lattice[static_cast<std::size_t>(b)];
            const double share = va < 0.0 ? crossing(pa, pb) : 1.0 - crossing(pb, pa);
            const double length = distance(pa, pb), limit = length > 1.05 * shortest ? kSnapLong : kSnapShort;
            const Point where = plus(pa, times(share, minus(pb, pa)));
            for (const auto& [end, part] : {std::pair{a, share}, std::pair{b, 1.0 - share}}) {
                if (part > limit || part * length >= nearest[static_cast<std::size_t>(end)]) continue;
                nearest[static_cast<std::size_t>(end)] = part * length;
                in_.nodes[static_cast<std::size_t>(end)] = where;
            }
        }
        for (std::size_t i = 0; i < nearest.size(); ++i)
            if (nearest[i] < 1e9) value_[i] = 0.0;
    }

    std::int32_t cut(std::int32_t inner, std::int32_t outer) {
        const auto [found, fresh] =
            cuts_.try_emplace(sorted_edge(inner, outer), static_cast<std::int32_t>(in_.nodes.size()));
        if (fresh) {
            const Point a = node(inner), b = node(outer);
            in_.nodes.push_back(plus(a, times(crossing(a, b), minus(b, a))));
        }
        return found->second;
    }

    // Both take the diagonal of each quadrilateral from its smallest node.
    static void add_pyramid(std::array<std::int32_t, 4> quad, std::int32_t apex, std::vector<Tet>& out) {
        const auto smallest = std::min_element(quad.begin(), quad.end());
        std::rotate(quad.begin(), smallest, quad.end());
        out.push_back({quad[0], quad[1], quad[2], apex});
        out.push_back({quad[0], quad[2], quad[3], apex});
    }
    static void add_prism(std::array<std::int32_t, 3> a, std::array<std::int32_t, 3> b, std::vector<Tet>& out) {
        const auto ia = std::min_element(a.begin(), a.end()), ib = std::min_element(b.begin(), b.end());
        if (*ib < *ia) {
            std::swap(a, b);
            std::rotate(a.begin(), a.begin() + (ib - b.begin()), a.end());
            std::rotate(b.begin(), b.begin() + (ib - b.begin()), b.end());
        } else {
            const auto turn = ia - a.begin();
            std::rotate(a.begin(), a.begin() + turn, a.end());
            std::rotate(b.begin(), b.begin() + turn, b.end());
        }
        // a[0] is the smallest of all: what is left is the triangle b and the quadrilateral a1 a2 b2 b1.
        out.push_back({a[0], b[0], b[1], b[2]});
        add_pyramid({a[1], a[2], b[2], b[1]}, a[0], out);
    }

    const Point& node(std::int32_t id) const { return in_.nodes[static_cast<std::size_t>(id)]; }

    const Level& level_;
    TetMeshData in_;
    std::vector<double> value_;
    std::map<Edge, std::int32_t> cuts_;
};

// Tetrahedra that share a face are of one piece; keeps the largest and drops unused nodes.
TetMeshData largest_piece(const std::vector<Point>& nodes, std::vector<Tet> tets) {
    std::vector<std::size_t> parent(tets.size());
    std::iota(parent.begin(), parent.end(), 0);
    const auto root = [&](std::size_t i) {
        while (parent[i] != i) i = parent[i] = parent[parent[i]];
        return i;
    };
    std::map<std::array<std::int32_t, 3>, std::size_t> faces;
    for (std::size_t t = 0; t < tets.size(); ++t)
        for (std::size_t skip = 0; skip < 4; ++skip) {
            std::array<std::int32_t, 3> face{};
            for (std::size_t i = 0, k = 0; i < 4; ++i)
                if (i != skip) face[k++] = tets[t][i];
            std::sort(face.begin(), face.end());
            const auto [found, fresh] = faces.try_emplace(face, t);
            if (!fresh) parent[root(t)] = root(found->second);
        }
    std::map<std::size_t, std::size_t> size;
    for (std::size_t t = 0; t < tets.size(); ++t) ++size[root(t)];
    const auto largest =
        std::max_element(size.begin(), size.end(), [](auto& a, auto& b) { return a.second < b.second; });
    TetMeshData mesh;
    std::map<std::int32_t, std::int32_t> renumber;
    for (std::size_t t = 0; t < tets.size(); ++t) {
        if (root(t) != largest->first) continue;
        for (std::int32_t& node : tets[t]) {
            const auto [found, fresh] = renumber.try_emplace(node, static_cast<std::int32_t>(renumber.size()));
            if (fresh) mesh.nodes.push_back(nodes[static_cast<std::size_t>(node)]);
            node = found->second;
        }
        mesh.tets.push_back(tets[t]);
        if (signed_volume_m3(mesh, mesh.tets.size() - 1) < 0.0) std::swap(mesh.tets.back()[2], mesh.tets.back()[3]);
    }
    return mesh;
}

double quality(const TetMeshData& mesh, std::size_t tet) {
    if (signed_volume_m3(mesh, tet) <= 0.0) return 0.0;
    const auto p = [&](std::size_t i) { return mesh.nodes[static_cast<std::size_t>(mesh.tets[tet][i])]; };
    return radius_ratio(p(0), p(1), p(2), p(3));
}

// Hill climbing: nodes of bad tetrahedra move to raise the worst quality around them; surface nodes stay on the
// surface.
void improve(TetMeshData& mesh, const Level& level) {
    constexpr double kGood = 0.35;
    constexpr int kRounds = 30, kTries = 8;
    Random random(7, {});
    std::vector<std::vector<std::size_t>> star(mesh.nodes.size());
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
        for (const std::int32_t node : mesh.tets[t]) star[static_cast<std::size_t>(node)].push_back(t);
    std::vector<char> on_surface(mesh.nodes.size(), 0);
    const Surface surface(mesh);
    for (const std::int32_t id : surface.nodes()) on_surface[static_cast<std::size_t>(id)] = 1;
    const auto worst = [&](std::size_t node) {
        double low = 1.0;
        for (const std::size_t t : star[node]) low = std::min(low, quality(mesh, t));
        return low;
    };
    for (int round = 0; round < kRounds; ++round) {
        std::set<std::size_t> moving;
        for (std::size_t t = 0; t < mesh.tets.size(); ++t)
            if (quality(mesh, t) < kGood)
                for (const std::int32_t node : mesh.tets[t]) moving.insert(static_cast<std::size_t>(node));
        for (const std::size_t node : moving) {
            const double reach = 0.2 * std::pow(0.93, round) * longest_edge_m(mesh, star[node].front());
            for (int i = 0; i < kTries; ++i) {
                const Point old = mesh.nodes[node];
                const double before = worst(node);
                mesh.nodes[node] = plus(old, times(reach * random.uniform(), random.direction()));
                if (on_surface[node] != 0) {  // two Newton steps back to level 0, gradient by differences
                    for (int step = 0; step < 2; ++step) {
                        Point& p = mesh.nodes[node];
                        Point g{};
                        for (std::size_t axis = 0; axis < 3; ++axis) {
                            Point q = p;
                            q[axis] += 1e-5;
                            g[axis] = (level(q) - level(p)) / 1e-5;
                        }
                        p = minus(p, times(level(p) / std::max(dot(g, g), 1e-12), g));
                    }
                }
                if (!(worst(node) > before)) mesh.nodes[node] = old;
            }
        }
    }
}

}  // namespace

double radius_ratio(const Point& a, const Point& b, const Point& c, const Point& d) {
    const Point u = minus(b, a), v = minus(c, a), w = minus(d, a);
    const double six_volume = std::abs(dot(u, cross(v, w)));
    if (six_volume == 0.0) return 0.0;
    const double area =
        0.5 * (norm(cross(u, v)) + norm(cross(v, w)) + norm(cross(w, u)) + norm(cross(minus(v, u), minus(w, u))));
    const Point centre =
        plus(plus(times(dot(u, u), cross(v, w)), times(dot(v, v), cross(w, u))), times(dot(w, w), cross(u, v)));
    return 3.0 * (0.5 * six_volume / area) * 2.0 * six_volume / norm(centre);
}

TetMeshData mesh_level_set(const Level& level, const LatticeOptions& options) {
    Clipper clipper(level, lattice(options));
    const std::vector<Tet> tets = clipper.clip();
    TetMeshData mesh = largest_piece(clipper.nodes(), tets);
    improve(mesh, level);
    return mesh;
}

}  // namespace teres::blindtest
