#include <algorithm>
#include <queue>
#include <set>

#include "tools/atlas/triangle_surface.h"

namespace teres {

using Eigen::Index;

// Shortest edge first; an edge is kept where its collapse would pinch the surface (link condition: its ends
// share exactly two neighbours).
TriangleSurface simplified(const TriangleSurface& surface, Index num_vertices) {
    const auto n = static_cast<std::size_t>(surface.num_vertices());
    Eigen::Matrix3Xd V = surface.V;
    auto faces = surface.F;
    std::vector<std::set<std::int32_t>> neighbour(n), around(n);  // vertices, faces
    std::vector<int> stamp(n, 0);
    for (std::size_t f = 0; f < faces.size(); ++f)
        for (std::size_t k = 0; k < 3; ++k) {
            const auto a = faces[f][k], b = faces[f][(k + 1) % 3];
            around[static_cast<std::size_t>(a)].insert(static_cast<std::int32_t>(f));
            neighbour[static_cast<std::size_t>(a)].insert(b);
            neighbour[static_cast<std::size_t>(b)].insert(a);
        }
    struct Edge {
        double length;
        std::int32_t a, b;
        int stamps;
        bool operator<(const Edge& other) const { return length > other.length; }
    };
    std::priority_queue<Edge> queue;
    const auto push = [&](std::int32_t a, std::int32_t b) {
        queue.push({(V.col(a) - V.col(b)).norm(), a, b,
                    stamp[static_cast<std::size_t>(a)] + stamp[static_cast<std::size_t>(b)]});
    };
    for (std::size_t a = 0; a < n; ++a)
        for (const auto b : neighbour[a])
            if (static_cast<std::int32_t>(a) < b) push(static_cast<std::int32_t>(a), b);
    Index left = surface.num_vertices();
    while (left > num_vertices && !queue.empty()) {
        const Edge e = queue.top();
        queue.pop();
        const auto a = static_cast<std::size_t>(e.a), b = static_cast<std::size_t>(e.b);
        if (around[a].empty() || around[b].empty() || stamp[a] + stamp[b] != e.stamps) continue;
        std::vector<std::int32_t> shared;
        std::set_intersection(neighbour[a].begin(), neighbour[a].end(), neighbour[b].begin(), neighbour[b].end(),
                              std::back_inserter(shared));
        if (shared.size() != 2) continue;
        V.col(e.a) = 0.5 * (V.col(e.a) + V.col(e.b));
        for (const auto f : std::set<std::int32_t>(around[b])) {
            auto& face = faces[static_cast<std::size_t>(f)];
            if (std::find(face.begin(), face.end(), e.a) != face.end()) {
                for (const auto v : face) around[static_cast<std::size_t>(v)].erase(f);
            } else {
                std::replace(face.begin(), face.end(), e.b, e.a);
                around[a].insert(f);
            }
        }
        around[b].clear();
        for (const auto v : neighbour[b]) {
            neighbour[static_cast<std::size_t>(v)].erase(e.b);
            if (v == e.a) continue;
            neighbour[static_cast<std::size_t>(v)].insert(e.a);
            neighbour[a].insert(v);
        }
        neighbour[b].clear();
        ++stamp[a];
        for (const auto v : neighbour[a]) push(e.a, v);
        --left;
    }
    TriangleSurface out;
    std::vector<std::int32_t> index(n, -1);
    out.V.resize(3, left);
    std::int32_t next = 0;
    for (std::size_t v = 0; v < n; ++v)
        if (!around[v].empty()) {
            out.V.col(next) = V.col(static_cast<Index>(v));
            index[v] = next++;
        }
    out.V.conservativeResize(3, next);
    for (std::size_t f = 0; f < faces.size(); ++f)
        if (around[static_cast<std::size_t>(faces[f][0])].contains(static_cast<std::int32_t>(f)))
            out.F.push_back({index[static_cast<std::size_t>(faces[f][0])], index[static_cast<std::size_t>(faces[f][1])],
                             index[static_cast<std::size_t>(faces[f][2])]});
    return out;
}

}  // namespace teres
