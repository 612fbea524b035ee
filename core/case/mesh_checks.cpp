#include "core/case/mesh_checks.h"

#include <algorithm>
#include <numeric>

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
    return invalid_input(name + ": the mesh falls into " + std::to_string(pieces.size()) + " pieces of " +
                         sizes + " nodes, expected 1");
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

    double extent = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
        const auto [low, high] =
            std::minmax_element(mesh.nodes.begin(), mesh.nodes.end(),
                                [k](const Point& a, const Point& b) { return a[k] < b[k]; });
        extent = std::max(extent, (*high)[k] - (*low)[k]);
    }
    if (extent > kLargestBody_m)
        return invalid_input(name + ": the body is " + to_text(extent) + " m long, at most " +
                             to_text(kLargestBody_m) +
                             " m is allowed; are the coordinates in millimetres? They must be in metres");
    if (extent < kSmallestBody_m)
        return invalid_input(name + ": the body is " + to_text(extent) + " m long, at least " +
                             to_text(kSmallestBody_m) + " m is needed; coordinates must be in metres");
    return {};
}

}  // namespace teres
