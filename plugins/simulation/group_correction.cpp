#include "plugins/simulation/group_correction.h"

#include <cmath>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

GroupCorrection::GroupCorrection(const std::vector<Tether>& tethers, std::size_t num_parameters,
                                 const BlockPattern& pattern, std::size_t max_lanes) {
    for (std::size_t p = 0; p < num_parameters; ++p) {
        Group group;
        group.parameter = p;
        for (std::size_t t = 0; t < tethers.size(); ++t)
            if (tethers[t].parameter == static_cast<std::int32_t>(p) &&
                pattern.free_index(tethers[t].node) >= 0) {
                group.tether.push_back(t);
                group.row.push_back(3 * pattern.free_index(tethers[t].node));
            }
        if (group.tether.empty()) continue;
        group.first = modes_;
        group.count = group.tether.size() >= 4 ? 12 : 3;  // affine, or translations of a few nodes
        modes_ += group.count;
        group.U.setZero(3 * static_cast<Eigen::Index>(group.tether.size()), group.count);
        group.y.setZero(3 * static_cast<Eigen::Index>(group.tether.size()), group.count);
        groups_.push_back(std::move(group));
    }
    W_.setZero(pattern.num_rows(), modes_);
    UtW_.setZero(modes_, modes_);
    G_inverse_.setZero(modes_, modes_);
    theta0_.assign(num_parameters, 0.0);
    lane_.assign(max_lanes, Eigen::PartialPivLU<Eigen::MatrixXd>(modes_));
    D_.assign(max_lanes, Eigen::MatrixXd::Zero(modes_, modes_));
    UtY_.setZero(modes_, static_cast<Eigen::Index>(max_lanes));
    c_.setZero(modes_);
}

void GroupCorrection::renew(const std::vector<Tether>& tethers, const double* theta0, const Positions& x,
                            Cholesky& K0) noexcept {
    if (empty()) return;
    W_.setZero();
    for (std::size_t p = 0; p < theta0_.size(); ++p) theta0_[p] = theta0[p];
    for (auto& group : groups_) {
        Vector3d centre = Vector3d::Zero();
        double radius = 0.0;
        for (const auto t : group.tether) centre += x.col(tethers[t].node);
        centre /= static_cast<double>(group.tether.size());
        for (const auto t : group.tether) radius = std::max(radius, (x.col(tethers[t].node) - centre).norm());
        if (!(radius > 0.0)) radius = 1.0;
        Eigen::MatrixXd G = Eigen::MatrixXd::Zero(group.count, group.count);
        Eigen::MatrixXd phi(3, group.count);
        for (std::size_t k = 0; k < group.tether.size(); ++k) {
            const auto t = group.tether[k];
            phi.leftCols<3>() = Matrix3d::Identity();
            const Vector3d d = (x.col(tethers[t].node) - centre) / radius;
            for (Eigen::Index m = 3; m < group.count; m += 3)
                phi.middleCols<3>(m) = d(m / 3 - 1) * Matrix3d::Identity();
            const Matrix3d B = tether_stiffness(tethers[t], x.col(tethers[t].node));
            const Eigen::MatrixXd u = B * phi;
            group.U.middleRows<3>(3 * static_cast<Eigen::Index>(k)) = u;
            W_.block(group.row[k], group.first, 3, group.count) += u;
            G.noalias() += phi.transpose() * u;
        }
        // A patch that is flat or slack leaves some modes without stiffness: keep the others.
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(G);
        const double cut = 1e-10 * std::max(eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-300);
        const Eigen::VectorXd inverse =
            eigen.eigenvalues().unaryExpr([cut](double v) { return v > cut ? 1.0 / v : 0.0; });
        G_inverse_.block(group.first, group.first, group.count, group.count) =
            eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
    }
    K0.solve(W_);  // W holds U
    for (const auto& group : groups_) {
        auto block = UtW_.middleRows(group.first, group.count);
        block.setZero();
        for (std::size_t k = 0; k < group.row.size(); ++k)
            block.noalias() += group.U.middleRows<3>(3 * static_cast<Eigen::Index>(k)).transpose() *
                               W_.middleRows<3>(group.row[k]);
    }
}

void GroupCorrection::set_lanes(const double* theta, std::size_t stride, std::size_t lanes) noexcept {
    if (empty()) return;
    for (std::size_t l = 0; l < lanes; ++l) {
        auto& D = D_[l];
        D.setZero();
        for (const auto& group : groups_)
            D.block(group.first, group.first, group.count, group.count) =
                (theta[group.parameter * stride + l] - theta0_[group.parameter]) *
                G_inverse_.block(group.first, group.first, group.count, group.count);
        lane_[l].compute(Eigen::MatrixXd::Identity(modes_, modes_) + D * UtW_);
    }
}

void GroupCorrection::apply(Eigen::Ref<Eigen::MatrixXd> Y) noexcept {
    if (empty()) return;
    for (Eigen::Index l = 0; l < Y.cols(); ++l) {
        for (auto& group : groups_) {
            for (std::size_t k = 0; k < group.row.size(); ++k)
                group.y.block<3, 1>(3 * static_cast<Eigen::Index>(k), 0) = Y.block<3, 1>(group.row[k], l);
            c_.segment(group.first, group.count).noalias() = group.U.transpose() * group.y.col(0);
        }
        const auto i = static_cast<std::size_t>(l);
        UtY_.col(l).noalias() = lane_[i].solve(D_[i] * c_);
    }
    Y.noalias() -= W_ * UtY_.leftCols(Y.cols());
}

}  // namespace teres
