#include "core/case/mesh_checks.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>
#include <utility>

#include "core/case/geometry.h"
#include "core/case/text_file.h"

namespace teres {
namespace {

constexpr double kLargestBody_m = 5.0;  // above, the coordinates are millimetres
constexpr double kSmallestBody_m = 1e-3;

std::size_t root_of(std::vector<std::size_t>& parent, std::size_t node) {
    while (parent[node] != node) node = parent[node] = parent[parent[node]];
    return node;
}

// Union-find over nodes that share a tetrahedron.
Status check_one_piece(const TetMeshData& mesh, const std::string& name) {
    std::vector<std::size_t> parent(mesh.nodes.size());
    std::iota(parent.begin(), parent.end(), std::size_t{0});
    for (const auto& tet : mesh.tets)
        for (std::size_t i = 1; i < 4; ++i)
            parent[root_of(parent, static_cast<std::size_t>(tet[i]))] =
                root_of(parent, static_cast<std::size_t>(tet[0]));
    std::vector<std::size_t> size(mesh.nodes.size(), 0);
    for (std::size_t node = 0; node < parent.size(); ++node) ++size[root_of(parent, node)];
    std::vector<std::size_t> pieces;
    for (const std::size_t nodes : size)
        if (nodes > 0) pieces.push_back(nodes);
    if (pieces.size() == 1) return {};
    std::sort(pieces.rbegin(), pieces.rend());
    std::string sizes;
    constexpr std::size_t kListed = 5;
    for (std::size_t i = 0; i < std::min(pieces.size(), kListed); ++i)
        sizes += (i == 0 ? "" : ", ") + std::to_string(pieces[i]);
    if (pieces.size() > kListed) sizes += ", ...";
    return invalid_input(name + ": the mesh falls into " + std::to_string(pieces.size()) + " pieces of " + sizes +
                         " nodes, expected 1");
}

// A face belongs to one tetrahedron (boundary) or to two that lie on its two sides. All tetrahedra are
// positive here, so the two see it in opposite order.
Status check_faces(const TetMeshData& mesh, const std::string& name) {
    struct Face {
        std::array<std::int32_t, 3> key;
        bool even;  // order of the nodes is an even permutation of the key
        std::size_t tet;
    };
    std::vector<Face> faces;
    faces.reserve(4 * mesh.tets.size());
    for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
        const auto [a, b, c, d] = mesh.tets[tet];
        for (auto key : {std::array{a, c, b}, std::array{a, b, d}, std::array{a, d, c}, std::array{b, c, d}}) {
            bool even = true;
            for (const auto& [i, j] : {std::pair{0u, 1u}, std::pair{1u, 2u}, std::pair{0u, 1u}})
                if (key[i] > key[j]) {
                    std::swap(key[i], key[j]);
                    even = !even;
                }
            faces.push_back({key, even, tet});
        }
    }
    std::sort(faces.begin(), faces.end(),
              [](const Face& x, const Face& y) { return std::tie(x.key, x.tet) < std::tie(y.key, y.tet); });
    for (std::size_t i = 0; i + 1 < faces.size(); ++i) {
        if (faces[i].key != faces[i + 1].key) continue;
        const std::string face = "face " + std::to_string(faces[i].key[0]) + " " + std::to_string(faces[i].key[1]) +
                                 " " + std::to_string(faces[i].key[2]);
        if (faces[i].even == faces[i + 1].even)
            return invalid_input(name + ": tetrahedra " + std::to_string(faces[i].tet) + " and " +
                                 std::to_string(faces[i + 1].tet) + " overlap: both lie on the same side of " + face);
        if (i + 2 < faces.size() && faces[i + 2].key == faces[i].key)
            return invalid_input(name + ": " + face + " belongs to more than 2 tetrahedra (" +
                                 std::to_string(faces[i].tet) + ", " + std::to_string(faces[i + 1].tet) + ", " +
                                 std::to_string(faces[i + 2].tet) + ")");
    }
    return {};
}

}  // namespace

Status check_body_mesh(const TetMeshData& mesh, const std::string& name) {
    std::vector<bool> used(mesh.nodes.size(), false);
    for (const auto& tet : mesh.tets)
        for (const std::int32_t id : tet) used[static_cast<std::size_t>(id)] = true;
    const auto unused = static_cast<std::size_t>(std::count(used.begin(), used.end(), false));
    if (unused > 0) {
        const auto first = std::find(used.begin(), used.end(), false) - used.begin();
        return invalid_input(name + ": node " + std::to_string(first) + " is in no tetrahedron (" +
                             std::to_string(unused) + " such nodes)");
    }
    TERES_TRY(check_one_piece(mesh, name));
    TERES_TRY(check_faces(mesh, name));

    double extent = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
        const auto [low, high] = std::minmax_element(mesh.nodes.begin(), mesh.nodes.end(),
                                                     [k](const Point& a, const Point& b) { return a[k] < b[k]; });
        extent = std::max(extent, (*high)[k] - (*low)[k]);
    }
    if (extent > kLargestBody_m)
        return invalid_input(name + ": the body is " + to_text(extent) + " m long, at most " + to_text(kLargestBody_m) +
                             " m is allowed; are the coordinates in millimetres? They must be in metres");
    if (extent < kSmallestBody_m)
        return invalid_input(name + ": the body is " + to_text(extent) + " m long, at least " +
                             to_text(kSmallestBody_m) + " m is needed; coordinates must be in metres");
    return {};
}

double size_m(const TetMeshData& mesh) {
    Point low = mesh.nodes.front(), high = low;
    for (const Point& x : mesh.nodes)
        for (std::size_t a = 0; a < 3; ++a) {
            low[a] = std::min(low[a], x[a]);
            high[a] = std::max(high[a], x[a]);
        }
    return distance(low, high);
}

}  // namespace teres
