#include "plugins/simulation/elastic_tets.h"

#include <Eigen/Geometry>
#include <cmath>

namespace teres {

void ElasticTets::couple(std::vector<std::set<NodeIndex>>& neighbours) const {
    for (const auto& tet : tets_)
        for (const auto a : tet)
            for (const auto b : tet)
                if (a != b) neighbours[static_cast<std::size_t>(a)].insert(b);
}

void ElasticTets::bind(const BlockPattern& pattern) {
    blocks_.clear();
    blocks_.reserve(10 * tets_.size());
    for (const auto& tet : tets_)
        for (std::size_t i = 0; i < 4; ++i)
            for (std::size_t j = i; j < 4; ++j) blocks_.push_back(pattern.block(tet[i], tet[j]));
}

Eigen::VectorXd mass_from_density(const TetMeshData& mesh, double density_kg_m3) {
    Eigen::VectorXd mass = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(mesh.nodes.size()));
    for (const auto& tet : mesh.tets) {
        const auto point = [&](int i) {
            const auto& p = mesh.nodes[static_cast<std::size_t>(tet[static_cast<std::size_t>(i)])];
            return Eigen::Vector3d(p[0], p[1], p[2]);
        };
        const Eigen::Vector3d a = point(0), b = point(1), c = point(2), d = point(3);
        const double volume = std::abs((b - a).cross(c - a).dot(d - a)) / 6.0;
        for (const auto node : tet) mass(node) += density_kg_m3 * volume / 4.0;
    }
    return mass;
}

}  // namespace teres
