#include "plugins/simulation/body.h"

#include <cmath>
#include <limits>

#include "plugins/simulation/body_kernels.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

void Body::couple(std::vector<std::set<NodeIndex>>& neighbours) const {
    for (const auto& set : points_)
        for (std::size_t q = 0; q < set.size(); ++q)
            for (auto i = set.offset[q]; i < set.offset[q + 1]; ++i)
                for (auto j = set.offset[q]; j < set.offset[q + 1]; ++j)
                    neighbours[static_cast<std::size_t>(set.node[static_cast<std::size_t>(i)])].insert(
                        set.node[static_cast<std::size_t>(j)]);
}

void Body::bind(const BlockPattern& pattern) {
    blocks_.clear();
    for (const auto& set : points_) {
        auto& blocks = blocks_.emplace_back();
        for (std::size_t q = 0; q < set.size(); ++q)
            for (auto i = set.offset[q]; i < set.offset[q + 1]; ++i)
                for (auto j = i; j < set.offset[q + 1]; ++j)
                    blocks.push_back(
                        pattern.block(set.node[static_cast<std::size_t>(i)], set.node[static_cast<std::size_t>(j)]));
    }
}

void Body::add_gradient(const PointShares& shares, int rank, const double* x, double* gradient, double* spare,
                        double* energy, std::size_t stride, std::size_t lanes) const noexcept {
    const auto r = static_cast<std::size_t>(rank);
    for (std::size_t s = 0; s < points_.size(); ++s) {
        const auto& share = shares.points(s);
        add_gradient_of_points(
            points_[s], {share.point.data() + share.first[r], share.first[r + 1] - share.first[r], share.row.data()},
            material_, x, gradient, spare, energy, stride, lanes);
    }
}

namespace {

// Tangent of what effects add to a point (strain_points.h).
void add_effects(const StrainPoints& set, const Material& material, std::size_t q, double psi, const Matrix3d& P,
                 Matrix9d& A) {
    if (set.stiffening != 0.0) {
        const double b = set.stiffening / (set.part.shear * material.mu());
        const Eigen::Map<const Eigen::Matrix<double, 9, 1>> p(P.data());
        A = (1.0 + b * psi) * A + b * p * p.transpose();
    }
    if (set.prestress.empty() || set.stiffness_scale[q] == 0.0) return;
    constexpr int kIndex[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    const double* S = &set.prestress[6 * q];
    for (int b = 0; b < 3; ++b)
        for (int d = 0; d < 3; ++d)
            for (int a = 0; a < 3; ++a) A(a + 3 * b, a + 3 * d) += S[kIndex[d][b]] / set.stiffness_scale[q];
}

}  // namespace

bool Body::add_tangent(const Positions& x, const BlockPattern& pattern, std::vector<double>& values) const noexcept {
    for (std::size_t s = 0; s < points_.size(); ++s) {
        const auto& set = points_[s];
        const std::int32_t* block = blocks_[s].data();
        for (std::size_t q = 0; q < set.size(); ++q) {
            const auto first = static_cast<std::size_t>(set.offset[q]),
                       last = static_cast<std::size_t>(set.offset[q + 1]);
            if (set.volume[q] * set.stiffness_scale[q] == 0.0) {  // cut away: F may be anything
                block += (last - first) * (last - first + 1) / 2;
                continue;
            }
            Matrix3d F = Matrix3d::Zero();
            for (auto i = first; i < last; ++i)
                F.noalias() += x.col(set.node[i]) * Eigen::Map<const Vector3d>(&set.gradient[3 * i]).transpose();
            double psi = 0.0;
            Matrix3d P;
            Matrix9d A;
            if (!material_.tangent(F, set.part, psi, P, A)) return false;
            add_effects(set, material_, q, psi, P, A);
            A *= set.volume[q] * set.stiffness_scale[q];
            for (auto i = first; i < last; ++i) {
                // B_i = dN_i . A: contracts the column index of P with dN_i
                const double* gi = &set.gradient[3 * i];
                const Eigen::Matrix<double, 3, 9> B =
                    gi[0] * A.middleRows<3>(0) + gi[1] * A.middleRows<3>(3) + gi[2] * A.middleRows<3>(6);
                for (auto j = i; j < last; ++j, ++block) {
                    if (*block < 0) continue;
                    const double* gj = &set.gradient[3 * j];
                    const Matrix3d K =
                        gj[0] * B.middleCols<3>(0) + gj[1] * B.middleCols<3>(3) + gj[2] * B.middleCols<3>(6);
                    pattern.add(set.node[i], set.node[j], *block, K, values);
                }
            }
        }
    }
    return true;
}

}  // namespace teres
