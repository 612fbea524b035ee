#include "plugins/simulation/metric_rotation.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr int kIterations = 20;
constexpr double kSmallTurn = 1e-5;  // rad

// The rotation next to A, from a guess (Mueller, Bender, Chentanez, Macklin: A robust method to extract the rotational
// part of deformations, MIG 2016).
void follow_rotation(const Eigen::Matrix3d& A, Eigen::Quaterniond& q) noexcept {
    for (int k = 0; k < kIterations; ++k) {
        const Eigen::Matrix3d R = q.toRotationMatrix();
        const Eigen::Vector3d moment = R.col(0).cross(A.col(0)) + R.col(1).cross(A.col(1)) + R.col(2).cross(A.col(2));
        const double inertia = std::abs(R.cwiseProduct(A).sum());
        const Eigen::Vector3d w = moment / (inertia + 1e-300);
        const double angle = w.norm();
        if (!(angle > 0.0) || !std::isfinite(angle)) return;
        q = Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle)) * q;
        q.normalize();
        if (angle < kSmallTurn) return;
    }
}

// y <- R y, or R^T y, for the three rows of a node.
template <bool kBack>
void turn_rows(const std::int32_t* row, const Eigen::Matrix3f& R, float* y, std::size_t stride) noexcept {
    float* r[3] = {y + static_cast<std::size_t>(row[0]) * stride, y + static_cast<std::size_t>(row[1]) * stride,
                   y + static_cast<std::size_t>(row[2]) * stride};
    const auto k = [&](int a, int b) { return kBack ? R(b, a) : R(a, b); };
    for (std::size_t l = 0; l < stride; ++l) {
        const float v0 = r[0][l], v1 = r[1][l], v2 = r[2][l];
        for (int a = 0; a < 3; ++a) r[a][l] = k(a, 0) * v0 + k(a, 1) * v1 + k(a, 2) * v2;
    }
}

}  // namespace

MetricRotation::MetricRotation(const BlockPattern& pattern, std::size_t num_nodes, const MetricSolver& metric) {
    std::vector<std::int32_t> row_of(static_cast<std::size_t>(pattern.num_rows()));
    for (std::size_t r = 0; r < metric.num_rows(); ++r)
        row_of[static_cast<std::size_t>(metric.free_row(r))] = static_cast<std::int32_t>(r);
    std::vector<NodeIndex> node_of(static_cast<std::size_t>(pattern.num_free_nodes()));
    for (std::size_t i = 0; i < num_nodes; ++i)
        if (const auto free = pattern.free_index(static_cast<NodeIndex>(i)); free >= 0)
            node_of[static_cast<std::size_t>(free)] = static_cast<NodeIndex>(i);
    std::vector<std::vector<NodeIndex>> neighbours(node_of.size());
    for (std::size_t column = 0; column < node_of.size(); ++column)
        for (auto k = pattern.column_start()[3 * column]; k < pattern.column_start()[3 * column + 1]; ++k) {
            const auto row = static_cast<std::size_t>(pattern.row()[static_cast<std::size_t>(k)]) / 3;
            if (row == column || pattern.row()[static_cast<std::size_t>(k)] % 3 != 0) continue;
            neighbours[column].push_back(node_of[row]);
            neighbours[row].push_back(node_of[column]);
        }
    for (std::size_t free = 0; free < node_of.size(); ++free) {
        nodes_.push_back({.node = node_of[free], .row = {}, .neighbours = neighbour_.size()});
        for (std::size_t a = 0; a < 3; ++a) nodes_.back().row[a] = row_of[3 * free + a];
        neighbour_.insert(neighbour_.end(), neighbours[free].begin(), neighbours[free].end());
    }
    turn_.assign(nodes_.size(), Eigen::Quaterniond::Identity());
    R_.assign(nodes_.size(), Eigen::Matrix3f::Identity());
    nodes_.push_back({.node = -1, .row = {}, .neighbours = neighbour_.size()});
    x0_ = Positions::Zero(3, static_cast<Eigen::Index>(num_nodes));
}

void MetricRotation::read(const Positions& x0) noexcept {
    x0_ = x0;
    std::fill(turn_.begin(), turn_.end(), Eigen::Quaterniond::Identity());
    std::fill(R_.begin(), R_.end(), Eigen::Matrix3f::Identity());
}

void MetricRotation::follow(const double* x, std::size_t stride) noexcept {
    const auto at = [&](NodeIndex i) {
        const double* p = x + 3 * static_cast<std::size_t>(i) * stride;
        return Eigen::Vector3d(p[0], p[stride], p[2 * stride]);
    };
    for (std::size_t n = 0; n + 1 < nodes_.size(); ++n) {
        const NodeIndex i = nodes_[n].node;
        const Eigen::Vector3d xi = at(i);
        Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
        for (std::size_t k = nodes_[n].neighbours; k < nodes_[n + 1].neighbours; ++k)
            A.noalias() += (at(neighbour_[k]) - xi) * (x0_.col(neighbour_[k]) - x0_.col(i)).transpose();
        follow_rotation(A, turn_[n]);
        R_[n] = turn_[n].toRotationMatrix().cast<float>();
    }
}

void MetricRotation::turn_back(float* y, std::size_t stride) const noexcept {
    for (std::size_t n = 0; n + 1 < nodes_.size(); ++n) turn_rows<true>(nodes_[n].row, R_[n], y, stride);
}

void MetricRotation::turn(float* y, std::size_t stride) const noexcept {
    for (std::size_t n = 0; n + 1 < nodes_.size(); ++n) turn_rows<false>(nodes_[n].row, R_[n], y, stride);
}

}  // namespace teres
