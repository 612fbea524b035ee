#include "plugins/simulation/system.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

MechanicalSystem::MechanicalSystem(Parts parts) : parts_(std::move(parts)) {
    std::vector<std::set<NodeIndex>> neighbours(num_nodes());
    parts_.body.couple(neighbours);
    couple(parts_.tethers, neighbours);
    pattern_ = BlockPattern::make(neighbours, parts_.held);
    parts_.body.bind(pattern_);
    work_ = std::make_unique<Work>(parts_.threads);
    work_->shares = PointShares(parts_.body.points(), parts_.X, parts_.threads);
}

void MechanicalSystem::resolve(std::span<const double> region_force_n, std::span<const double> tool_position_m,
                               ExternalActions& out) const {
    out.force_n.setZero(static_cast<Eigen::Index>(3 * num_nodes()));
    for (std::size_t i = 0; i < num_nodes(); ++i)  // m g
        out.force_n.segment<3>(static_cast<Eigen::Index>(3 * i)) =
            parts_.node_mass_kg(static_cast<Eigen::Index>(i)) * parts_.gravity_m_s2;
    for (std::size_t r = 0; r < parts_.loads.size() && 3 * r + 2 < region_force_n.size(); ++r) {
        const Vector3d force(region_force_n[3 * r], region_force_n[3 * r + 1], region_force_n[3 * r + 2]);
        if (!force.allFinite()) continue;
        const auto& patch = parts_.loads[r];
        for (std::size_t k = 0; k < patch.node.size(); ++k)
            out.force_n.segment<3>(3 * static_cast<Eigen::Index>(patch.node[k])) += patch.weight[k] * force;
    }
    out.tool_position_m.resize(3, static_cast<Eigen::Index>(parts_.tools.size()));
    for (std::size_t k = 0; k < 3 * parts_.tools.size(); ++k)
        out.tool_position_m.data()[k] = k < tool_position_m.size() ? tool_position_m[k] : std::nan("");
}

void MechanicalSystem::gradient(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                                const double* x, double* gradient, double* energy, std::size_t stride,
                                std::size_t lanes) const noexcept {
    auto& w = *work_;
    const auto threads = static_cast<std::size_t>(w.team.threads());
    if (w.energy.size() < threads * stride) {
        w.energy.resize(threads * stride);
        w.spare.resize(3 * w.shares.num_spare_rows() * stride);
    }
    w.team.split(num_nodes(), [&](int rank, std::size_t first, std::size_t last) {
        double* share = &w.energy[static_cast<std::size_t>(rank) * stride];
        std::fill_n(share, stride, 0.0);
        for (std::size_t d = 3 * first; d < 3 * last; ++d) {
            const double f = actions.force_n(static_cast<Eigen::Index>(d)), X = parts_.X.data()[d];
            const double c = inertia.coefficient * parts_.node_mass_kg(static_cast<Eigen::Index>(d / 3));
            for (std::size_t l = 0; l < stride; ++l) {
                gradient[d * stride + l] = -f;
                share[l] -= f * (x[d * stride + l] - X);  // work from rest: small numbers keep their digits
            }
            for (std::size_t l = 0; l < stride && c != 0.0; ++l) {
                const double e = x[d * stride + l] - inertia.target[d * stride + l];
                gradient[d * stride + l] += c * e;
                share[l] += 0.5 * c * e * e;
            }
        }
    });
    w.team.run([&](int rank) {
        std::fill(w.spare.begin() + static_cast<std::ptrdiff_t>(3 * w.shares.spare_begin(rank) * stride),
                  w.spare.begin() + static_cast<std::ptrdiff_t>(3 * w.shares.spare_begin(rank + 1) * stride), 0.0);
        parts_.body.add_gradient(w.shares, rank, x, gradient, w.spare.data(),
                                 &w.energy[static_cast<std::size_t>(rank) * stride], stride, lanes);
    });
    w.shares.add_spares(w.spare.data(), gradient, stride);
    std::copy_n(w.energy.begin(), stride, energy);
    for (std::size_t t = 1; t < threads; ++t)
        for (std::size_t l = 0; l < stride; ++l) energy[l] += w.energy[t * stride + l];
    // Tethers share nodes: the threads take lanes of their own.
    w.team.split((lanes + kPackLanes - 1) / kPackLanes, [&](int, std::size_t first, std::size_t last) {
        const std::size_t l = first * kPackLanes, count = std::min(last * kPackLanes, lanes) - l;
        if (first < last)
            add_tether_gradient(parts_.tethers, theta + l, x + l, gradient + l, energy + l, stride, count);
    });
    if (parts_.term != nullptr) parts_.term->add_gradient(x, gradient, energy, stride, lanes);
    for (std::size_t k = 0; k < parts_.tools.size(); ++k) {
        const auto& tool = parts_.tools[k];
        const auto target = actions.tool_position_m.col(static_cast<Eigen::Index>(k));
        if (!target.allFinite()) continue;
        for (std::size_t a = 0; a < 3; ++a) {
            const std::size_t d = 3 * static_cast<std::size_t>(tool.node) + a;
            for (std::size_t l = 0; l < stride; ++l) {
                const double e = x[d * stride + l] - target(static_cast<Eigen::Index>(a));
                gradient[d * stride + l] += tool.stiffness_n_per_m * e;
                energy[l] += 0.5 * tool.stiffness_n_per_m * e * e;
            }
        }
    }
    if (inertia.damping != nullptr && inertia.damping->coefficient != 0.0)
        add_damping(inertia, x, gradient, energy, stride, lanes);
    for (std::size_t i = 0; i < num_nodes(); ++i)
        if (parts_.held[i]) std::fill(gradient + 3 * i * stride, gradient + 3 * (i + 1) * stride, 0.0);
}

void MechanicalSystem::add_damping(const Inertia& inertia, const double* x, double* gradient, double* energy,
                                   std::size_t stride, std::size_t lanes) const noexcept {
    auto& damping = *inertia.damping;
    const double c = damping.coefficient;
    for (std::size_t l = 0; l < lanes; ++l) {
        for (std::size_t i = 0; i < num_nodes(); ++i)
            if (const auto row = pattern_.free_index(static_cast<NodeIndex>(i)); row >= 0)
                for (std::size_t a = 0; a < 3; ++a) {
                    const std::size_t d = (3 * i + a) * stride + l;
                    damping.difference[static_cast<std::size_t>(3 * row) + a] = x[d] - damping.target[d];
                }
        std::fill(damping.product.begin(), damping.product.end(), 0.0);
        pattern_.multiply(damping.values[inertia.damping_lane + l], damping.difference.data(), damping.product.data());
        for (std::size_t i = 0; i < num_nodes(); ++i)
            if (const auto row = pattern_.free_index(static_cast<NodeIndex>(i)); row >= 0)
                for (std::size_t a = 0; a < 3; ++a) {
                    const std::size_t r = static_cast<std::size_t>(3 * row) + a;
                    gradient[(3 * i + a) * stride + l] += c * damping.product[r];
                    energy[l] += 0.5 * c * damping.product[r] * damping.difference[r];
                }
    }
}

bool MechanicalSystem::tangent(const ExternalActions& actions, const Inertia& inertia, std::size_t lane,
                               const double* theta, const Positions& x, std::vector<double>& values) const noexcept {
    const double inertia_coefficient = inertia.coefficient;
    values.assign(pattern_.num_values(), 0.0);
    if (!parts_.body.add_tangent(x, pattern_, values)) return false;
    add_tether_tangent(parts_.tethers, theta, x, pattern_, values);
    if (parts_.term != nullptr) parts_.term->add_tangent(x, pattern_, values);
    for (std::size_t k = 0; k < parts_.tools.size(); ++k) {
        const auto& tool = parts_.tools[k];
        if (!actions.tool_position_m.col(static_cast<Eigen::Index>(k)).allFinite()) continue;
        pattern_.add(tool.node, tool.node, pattern_.block(tool.node, tool.node),
                     tool.stiffness_n_per_m * Matrix3d::Identity(), values);
    }
    if (inertia_coefficient != 0.0)
        for (std::size_t i = 0; i < num_nodes(); ++i)
            if (!parts_.held[i]) {
                const auto node = static_cast<NodeIndex>(i);
                pattern_.add(
                    node, node, pattern_.block(node, node),
                    inertia_coefficient * parts_.node_mass_kg(static_cast<Eigen::Index>(i)) * Matrix3d::Identity(),
                    values);
            }
    if (inertia.damping != nullptr && inertia.damping->coefficient != 0.0) {
        const auto& K = inertia.damping->values[inertia.damping_lane + lane];
        for (std::size_t k = 0; k < values.size(); ++k) values[k] += inertia.damping->coefficient * K[k];
    }
    return true;
}

}  // namespace teres
