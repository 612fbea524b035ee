#include "plugins/simulation/tissue_cut.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace teres {

std::vector<char> tissue_left(const TetMesh& mesh, std::span<const std::int32_t> cut, const std::vector<char>& holds) {
    std::vector<char> left(mesh.tets.size());
    for (std::size_t e = 0; e < left.size(); ++e) left[e] = mesh.volume[e] > 0.0;
    for (const auto e : cut) left[static_cast<std::size_t>(e)] = 0;
    if (holds.empty()) return left;
    // Pieces: nodes that share a tetrahedron have the same root.
    std::vector<NodeIndex> parent(mesh.num_nodes());
    std::iota(parent.begin(), parent.end(), 0);
    const auto root = [&](NodeIndex a) {
        while (parent[static_cast<std::size_t>(a)] != a) {
            auto& above = parent[static_cast<std::size_t>(a)];
            a = above = parent[static_cast<std::size_t>(above)];
        }
        return a;
    };
    for (std::size_t e = 0; e < left.size(); ++e)
        for (std::size_t i = 1; i < 4 && left[e]; ++i)
            parent[static_cast<std::size_t>(root(mesh.tets[e][i]))] = root(mesh.tets[e][0]);
    std::vector<char> piece_held(mesh.num_nodes(), 0);
    for (std::size_t a = 0; a < mesh.num_nodes(); ++a)
        if (holds[a]) piece_held[static_cast<std::size_t>(root(static_cast<NodeIndex>(a)))] = 1;
    for (std::size_t e = 0; e < left.size(); ++e)
        left[e] = left[e] && piece_held[static_cast<std::size_t>(root(mesh.tets[e][0]))];
    return left;
}

std::int32_t keep_tissue(const std::vector<char>& left, TetMesh& mesh, MechanicalSystem::Parts& parts) noexcept {
    std::int32_t removed = 0;
    std::vector<char> touched(mesh.num_nodes(), 0);
    for (std::size_t e = 0; e < left.size(); ++e) {
        if (left[e] || mesh.volume[e] == 0.0) continue;
        ++removed;
        mesh.volume[e] = 0.0;
        for (const auto a : mesh.tets[e]) touched[static_cast<std::size_t>(a)] = 1;
    }
    const std::vector<double> before = mesh.node_volume;
    std::fill(mesh.node_volume.begin(), mesh.node_volume.end(), 0.0);
    for (std::size_t e = 0; e < left.size(); ++e)
        for (const auto a : mesh.tets[e]) mesh.node_volume[static_cast<std::size_t>(a)] += 0.25 * mesh.volume[e];
    follow_volumes(mesh, parts.body.points());

    std::vector<char> bare(mesh.num_nodes(), 0);
    for (std::size_t a = 0; a < mesh.num_nodes(); ++a) {
        if (!touched[a]) continue;
        parts.node_mass_kg(static_cast<Eigen::Index>(a)) *= mesh.node_volume[a] / before[a];
        bare[a] = mesh.node_volume[a] == 0.0;
        if (!bare[a]) continue;
        Tether tie;  // k |x - X|^2 / 2, as stiff as the tissue was
        tie.node = static_cast<NodeIndex>(a);
        tie.share = parts.body.material().mu() * std::cbrt(before[a]);
        tie.band = {parts.X.col(static_cast<Eigen::Index>(a)), Eigen::Vector3d::UnitZ(), 1.0, 0.0};
        for (auto& t : parts.tethers) {
            if (t.node == tie.node) t.share = 0.0;
            for (auto& spring : t.fan.near)
                if (spring.node == tie.node) spring.weight = 0.0;
        }
        parts.tethers.push_back(tie);
    }
    for (auto& load : parts.loads) {  // the whole force acts on the nodes that are left
        double sum = 0.0;
        for (std::size_t k = 0; k < load.node.size(); ++k) {
            if (bare[static_cast<std::size_t>(load.node[k])]) load.weight[k] = 0.0;
            sum += load.weight[k];
        }
        for (auto& weight : load.weight)
            if (sum > 0.0) weight /= sum;
    }
    return removed;
}

void release(std::int32_t parameter, std::vector<Tether>& tethers) noexcept {
    for (auto& t : tethers)
        if (t.parameter == parameter) t.share = 0.0;
}

}  // namespace teres
