#include "plugins/simulation/group_correction.h"

#include <cmath>
#include <set>

#include "plugins/simulation/metric_kernels.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

GroupCorrection::GroupCorrection(const std::vector<Tether>& tethers, std::size_t num_parameters,
                                 const BlockPattern& pattern, const MetricSolver& metric, std::size_t max_lanes)
    : rows_(metric.num_rows()) {
    std::vector<std::int32_t> row_of(rows_);
    for (std::size_t r = 0; r < rows_; ++r)
        row_of[static_cast<std::size_t>(metric.free_row(r))] = static_cast<std::int32_t>(r);
    for (std::size_t p = 0; p < num_parameters; ++p) {
        Group group;
        group.parameter = p;
        std::set<NodeIndex> nodes;
        for (std::size_t t = 0; t < tethers.size(); ++t) {
            if (tethers[t].parameter != static_cast<std::int32_t>(p)) continue;
            group.tether.push_back(t);
            for (std::size_t i = 0; i < tethers[t].num_nodes(); ++i)
                if (pattern.free_index(tethers[t].node_at(i)) >= 0) nodes.insert(tethers[t].node_at(i));
        }
        if (nodes.empty()) continue;
        group.node.assign(nodes.begin(), nodes.end());
        for (const auto node : group.node)
            for (std::size_t a = 0; a < 3; ++a)
                group.row.push_back(row_of[3 * static_cast<std::size_t>(pattern.free_index(node)) + a]);
        group.first = modes_;
        group.count = group.node.size() >= 4 ? 12 : 3;  // affine, or translations of a few nodes
        modes_ += group.count;
        group.U.setZero(static_cast<Eigen::Index>(group.row.size()), group.count);
        group.phi.setZero(group.U.rows(), group.count);
        group.B_phi.setZero(group.U.rows(), group.count);
        groups_.push_back(std::move(group));
    }
    const auto stride = MetricSolver::lane_stride(static_cast<std::size_t>(modes_));
    W_.assign(metric.num_storage_rows() * stride, 0.0f);
    C_.assign(stride * MetricSolver::lane_stride(max_lanes), 0.0f);
    UtW_.setZero(modes_, modes_);
    G_inverse_.setZero(modes_, modes_);
    theta0_.assign(num_parameters, 0.0);
    const Lane lane{Eigen::PartialPivLU<Eigen::MatrixXf>(modes_), Eigen::MatrixXf::Zero(modes_, modes_),
                    Eigen::MatrixXf::Zero(modes_, modes_), Eigen::VectorXf::Zero(modes_),
                    Eigen::VectorXf::Zero(modes_)};
    lane_.assign(max_lanes, lane);
}

void GroupCorrection::read(const std::vector<Tether>& tethers, const double* theta0, const Positions& x) noexcept {
    if (modes_ == 0) return;
    const auto modes = static_cast<std::size_t>(modes_), stride = MetricSolver::lane_stride(modes);
    renewed_ = false;
    std::fill(W_.begin(), W_.end(), 0.0f);
    for (std::size_t p = 0; p < theta0_.size(); ++p) theta0_[p] = theta0[p];
    for (auto& group : groups_) {
        Vector3d centre = Vector3d::Zero();
        double radius = 0.0;
        for (const auto node : group.node) centre += x.col(node) / static_cast<double>(group.node.size());
        for (const auto node : group.node) radius = std::max(radius, (x.col(node) - centre).norm());
        if (!(radius > 0.0)) radius = 1.0;
        for (std::size_t k = 0; k < group.node.size(); ++k) {
            auto phi = group.phi.middleRows<3>(3 * static_cast<Eigen::Index>(k));
            phi.leftCols<3>() = Matrix3d::Identity();
            const Vector3d d = (x.col(group.node[k]) - centre) / radius;
            for (Eigen::Index m = 3; m < group.count; m += 3)
                phi.middleCols<3>(m) = d(m / 3 - 1) * Matrix3d::Identity();
        }
        group.B_phi.setZero();
        for (const auto t : group.tether)
            for_stiffness_blocks(tethers[t], x, [&](std::size_t i, std::size_t j, const Matrix3d& B) {
                const auto a = group.place(tethers[t].node_at(i)), b = group.place(tethers[t].node_at(j));
                if (a >= 0 && b >= 0) group.B_phi.middleRows<3>(3 * a).noalias() += B * group.phi.middleRows<3>(3 * b);
            });
        group.U = group.B_phi.cast<float>();
        for (std::size_t i = 0; i < group.row.size(); ++i)
            for (Eigen::Index m = 0; m < group.count; ++m)
                W_[static_cast<std::size_t>(group.row[i]) * stride + static_cast<std::size_t>(group.first + m)] =
                    group.U(static_cast<Eigen::Index>(i), m);
        const Eigen::MatrixXd G = group.phi.transpose() * group.B_phi;
        // A patch that is flat or slack leaves some modes without stiffness: keep the others.
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(G);
        const double cut = 1e-10 * std::max(eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-300);
        const Eigen::VectorXd inverse =
            eigen.eigenvalues().unaryExpr([cut](double v) { return v > cut ? 1.0 / v : 0.0; });
        G_inverse_.block(group.first, group.first, group.count, group.count) =
            (eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose()).cast<float>();
    }
}

void GroupCorrection::renew(MetricSolver& metric, TaskTeam& team) noexcept {
    if (modes_ == 0) return;
    const auto modes = static_cast<std::size_t>(modes_), stride = MetricSolver::lane_stride(modes);
    renewed_ = true;
    metric.solve(W_.data(), modes, team);  // W held U
    UtW_.setZero();
    for (const auto& group : groups_)
        for (std::size_t i = 0; i < group.row.size(); ++i)
            UtW_.middleRows(group.first, group.count).noalias() +=
                group.U.row(static_cast<Eigen::Index>(i)).transpose() *
                Eigen::Map<const Eigen::RowVectorXf>(&W_[static_cast<std::size_t>(group.row[i]) * stride], modes_);
}

void GroupCorrection::set_lanes(const double* theta, std::size_t stride, std::size_t lanes, MetricSolver& metric,
                                TaskTeam& team) noexcept {
    active_ = false;
    for (const auto& group : groups_)
        for (std::size_t l = 0; l < lanes; ++l)
            active_ = active_ || theta[group.parameter * stride + l] != theta0_[group.parameter];
    if (!active_) return;
    if (!renewed_) renew(metric, team);
    team.split(lanes, [&](int, std::size_t first, std::size_t last) {
        for (std::size_t l = first; l < last; ++l) {
            auto& lane = lane_[l];
            lane.A.setIdentity();
            for (const auto& group : groups_) {
                const auto change = static_cast<float>(theta[group.parameter * stride + l] - theta0_[group.parameter]);
                auto D = lane.D.block(group.first, group.first, group.count, group.count);
                D = change * G_inverse_.block(group.first, group.first, group.count, group.count);
                lane.A.middleRows(group.first, group.count).noalias() +=
                    D.lazyProduct(UtW_.middleRows(group.first, group.count));
            }
            lane.lu.compute(lane.A);
        }
    });
}

void GroupCorrection::apply(float* y, std::size_t lanes, std::size_t open, TaskTeam& team) noexcept {
    if (!active_) return;
    const auto modes = static_cast<std::size_t>(modes_), stride = MetricSolver::lane_stride(lanes);
    team.split(open, [&](int, std::size_t first, std::size_t last) {
        for (std::size_t l = first; l < last; ++l) {
            auto& lane = lane_[l];
            lane.c.setZero();
            for (const auto& group : groups_) {
                auto c = lane.c.segment(group.first, group.count);
                for (std::size_t i = 0; i < group.row.size(); ++i)
                    c += y[static_cast<std::size_t>(group.row[i]) * stride + l] *
                         group.U.row(static_cast<Eigen::Index>(i)).transpose();
                lane.Dc.segment(group.first, group.count).noalias() =
                    lane.D.block(group.first, group.first, group.count, group.count).lazyProduct(c);
            }
            lane.c = lane.lu.permutationP() * lane.Dc;
            lane.lu.matrixLU().triangularView<Eigen::UnitLower>().solveInPlace(lane.c);
            lane.lu.matrixLU().triangularView<Eigen::Upper>().solveInPlace(lane.c);
            for (std::size_t m = 0; m < modes; ++m) C_[m * stride + l] = lane.c(static_cast<Eigen::Index>(m));
        }
    });
    team.split(rows_, [&](int, std::size_t first, std::size_t last) {
        subtract_product(W_.data(), C_.data(), y, first, last, modes, MetricSolver::lane_stride(modes), stride);
    });
}

}  // namespace teres
