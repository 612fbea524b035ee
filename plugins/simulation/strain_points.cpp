#include "plugins/simulation/strain_points.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

namespace teres {

using Eigen::Vector3d;

namespace {

void append_entry(StrainPoints& points, NodeIndex node, const Vector3d& g) {
    points.node.push_back(node);
    points.gradient.insert(points.gradient.end(), g.data(), g.data() + 3);
}

void close_point(StrainPoints& points, double volume) {
    points.offset.push_back(static_cast<std::int32_t>(points.node.size()));
    points.volume.push_back(volume);
    points.stiffness_scale.push_back(1.0);
}

StrainPoints element_points(const TetMesh& mesh, PartWeights part) {
    StrainPoints points;
    points.part = part;
    points.offset.push_back(0);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        for (int i = 0; i < 4; ++i)
            append_entry(points, mesh.tets[e][static_cast<std::size_t>(i)], mesh.gradient[e].col(i));
        close_point(points, mesh.volume[e]);
    }
    return points;
}

// F_a = (1/V_a) sum_e V_e/4 F_e over the tetrahedra around node a, V_a = sum_e V_e/4.
StrainPoints nodal_points(const TetMesh& mesh, PartWeights part) {
    std::vector<std::map<NodeIndex, Vector3d>> patch(mesh.num_nodes());
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        for (const auto a : mesh.tets[e])
            for (int i = 0; i < 4; ++i) {
                auto [entry, added] = patch[static_cast<std::size_t>(a)].try_emplace(
                    mesh.tets[e][static_cast<std::size_t>(i)], Vector3d::Zero());
                entry->second += mesh.volume[e] / 4.0 * mesh.gradient[e].col(i);
            }
    StrainPoints points;
    points.part = part;
    points.point_of_node.assign(mesh.num_nodes(), -1);
    points.offset.push_back(0);
    for (std::size_t a = 0; a < patch.size(); ++a) {
        if (mesh.node_volume[a] <= 0.0) continue;
        points.point_of_node[a] = static_cast<std::int32_t>(points.size());
        for (const auto& [node, g] : patch[a]) append_entry(points, node, g / mesh.node_volume[a]);
        close_point(points, mesh.node_volume[a]);
    }
    return points;
}

// Four-point rule of degree 2 (Keast), barycentric (a, b, b, b) and permutations.
StrainPoints quadratic_points(const TetMesh& mesh) {
    const QuadraticMesh quadratic = make_quadratic(mesh);
    constexpr int kEdges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
    const double a = (5.0 + 3.0 * std::sqrt(5.0)) / 20.0, b = (5.0 - std::sqrt(5.0)) / 20.0;
    StrainPoints points;
    points.offset.push_back(0);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        for (int q = 0; q < 4; ++q) {
            Eigen::Vector4d L = Eigen::Vector4d::Constant(b);
            L(q) = a;
            std::vector<std::pair<NodeIndex, Vector3d>> entries;
            const auto& g = mesh.gradient[e];
            for (int i = 0; i < 4; ++i)  // N_i = L_i (2 L_i - 1)
                entries.emplace_back(quadratic.tets[e][static_cast<std::size_t>(i)], (4.0 * L(i) - 1.0) * g.col(i));
            for (int k = 0; k < 6; ++k) {  // N_ij = 4 L_i L_j
                const int i = kEdges[k][0], j = kEdges[k][1];
                entries.emplace_back(quadratic.tets[e][static_cast<std::size_t>(4 + k)],
                                     4.0 * (L(i) * g.col(j) + L(j) * g.col(i)));
            }
            std::sort(entries.begin(), entries.end(), [](const auto& l, const auto& r) { return l.first < r.first; });
            for (const auto& [node, gradient] : entries) append_entry(points, node, gradient);
            close_point(points, mesh.volume[e] / 4.0);
        }
    return points;
}

}  // namespace

QuadraticMesh make_quadratic(const TetMesh& mesh) {
    constexpr int kEdges[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};
    QuadraticMesh out;
    std::map<std::array<NodeIndex, 2>, NodeIndex> mid;
    const auto corners = static_cast<NodeIndex>(mesh.num_nodes());
    for (const auto& t : mesh.tets) {
        std::array<NodeIndex, 10> q{t[0], t[1], t[2], t[3]};
        for (std::size_t k = 0; k < 6; ++k) {
            std::array<NodeIndex, 2> edge{t[static_cast<std::size_t>(kEdges[k][0])],
                                          t[static_cast<std::size_t>(kEdges[k][1])]};
            std::sort(edge.begin(), edge.end());
            const auto [entry, added] = mid.try_emplace(edge, corners + static_cast<NodeIndex>(out.edge.size()));
            if (added) out.edge.push_back(edge);
            q[4 + k] = entry->second;
        }
        out.tets.push_back(q);
    }
    out.X.resize(3, corners + static_cast<Eigen::Index>(out.edge.size()));
    out.X.leftCols(corners) = mesh.X;
    for (std::size_t i = 0; i < out.edge.size(); ++i)
        out.X.col(corners + static_cast<Eigen::Index>(i)) =
            0.5 * (mesh.X.col(out.edge[i][0]) + mesh.X.col(out.edge[i][1]));
    return out;
}

std::vector<StrainPoints> make_strain_points(const TetMesh& mesh, ElementType type, double shear_blend) {
    switch (type) {
        case ElementType::kLinear:
            return {element_points(mesh, {1.0, 1.0})};
        case ElementType::kNodalVolume:
            return {element_points(mesh, {1.0, 0.0}), nodal_points(mesh, {0.0, 1.0})};
        case ElementType::kNodalBlend:
            return {element_points(mesh, {shear_blend, 0.0}), nodal_points(mesh, {1.0 - shear_blend, 1.0})};
        case ElementType::kQuadratic:
            return {quadratic_points(mesh)};
    }
    return {};
}

void follow_volumes(const TetMesh& mesh, std::vector<StrainPoints>& points) noexcept {
    for (auto& set : points) {
        if (set.point_of_node.empty()) {
            std::copy(mesh.volume.begin(), mesh.volume.end(), set.volume.begin());
            continue;
        }
        std::fill(set.gradient.begin(), set.gradient.end(), 0.0);
        for (std::size_t a = 0; a < mesh.num_nodes(); ++a)
            if (set.point_of_node[a] >= 0)
                set.volume[static_cast<std::size_t>(set.point_of_node[a])] = mesh.node_volume[a];
        for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
            if (mesh.volume[e] == 0.0) continue;
            for (const auto a : mesh.tets[e]) {
                const auto q = static_cast<std::size_t>(set.point_of_node[static_cast<std::size_t>(a)]);
                const double share = 0.25 * mesh.volume[e] / mesh.node_volume[static_cast<std::size_t>(a)];
                for (std::size_t i = 0; i < 4; ++i) {
                    const auto entry = std::lower_bound(set.node.begin() + set.offset[q],
                                                        set.node.begin() + set.offset[q + 1], mesh.tets[e][i]) -
                                       set.node.begin();
                    Eigen::Map<Vector3d>(&set.gradient[3 * static_cast<std::size_t>(entry)]) +=
                        share * mesh.gradient[e].col(static_cast<Eigen::Index>(i));
                }
            }
        }
    }
}

std::vector<StrainPoints> separate_parts(std::vector<StrainPoints> points) {
    std::vector<StrainPoints> out;
    for (auto& set : points) {
        if (set.part.shear != 0.0 && set.part.volume != 0.0) {
            out.push_back(set);
            out.back().part.volume = 0.0;
            set.part.shear = 0.0;
        }
        out.push_back(std::move(set));
    }
    return out;
}

}  // namespace teres
