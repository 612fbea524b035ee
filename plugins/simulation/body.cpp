#include "plugins/simulation/body.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "plugins/simulation/body_kernels.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Body::Body(std::vector<StrainPoints> points, Material material) : points_(std::move(points)), material_(material) {
    for (std::size_t s = 0; s < points_.size(); ++s) {
        const auto same = std::find_if(alike_.begin(), alike_.end(), [&](const auto& sets) {
            const StrainPoints &set = points_[s], &other = points_[sets.front()];
            return sets.size() < kMostAlike && other.offset == set.offset && other.node == set.node &&
                   other.gradient == set.gradient;
        });
        if (same != alike_.end())
            same->push_back(s);
        else
            alike_.push_back({s});
    }
}

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
    for (const auto& sets : alike_) {
        const StrainPoints& set = points_[sets.front()];
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
    for (const auto& alike : alike_) {
        const auto& share = shares.points(alike.front());
        std::array<const StrainPoints*, kMostAlike> sets{};
        for (std::size_t k = 0; k < alike.size(); ++k) sets[k] = &points_[alike[k]];
        add_gradient_of_points(
            {sets.data(), alike.size()}, {share.point.data() + share.first[r], share.first[r + 1] - share.first[r], share.row.data()},
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

// Of all sets that share their points; false if the law is undefined at one of them.
bool Body::tangent_at(const std::vector<std::size_t>& sets, std::size_t q, const Matrix3d& F,
                      Matrix9d& A) const noexcept {
    A.setZero();
    for (const std::size_t s : sets) {
        const StrainPoints& set = points_[s];
        const double scale = set.volume[q] * set.stiffness_scale[q];
        if (scale == 0.0) continue;  // cut away: F may be anything
        double psi = 0.0;
        Matrix3d P;
        Matrix9d of_set;
        if (!material_.tangent(F, set.part, psi, P, of_set)) return false;
        add_effects(set, material_, q, psi, P, of_set);
        A += scale * of_set;
    }
    return true;
}

bool Body::add_tangent(const Positions& x, const BlockPattern& pattern, std::vector<double>& values) const noexcept {
    for (std::size_t k = 0; k < alike_.size(); ++k) {
        const auto& sets = alike_[k];
        const StrainPoints& set = points_[sets.front()];
        const std::int32_t* block = blocks_[k].data();
        for (std::size_t q = 0; q < set.size(); ++q) {
            const auto first = static_cast<std::size_t>(set.offset[q]),
                       last = static_cast<std::size_t>(set.offset[q + 1]);
            Matrix3d F = Matrix3d::Zero();
            for (auto i = first; i < last; ++i)
                F.noalias() += x.col(set.node[i]) * Eigen::Map<const Vector3d>(&set.gradient[3 * i]).transpose();
            Matrix9d A;
            if (!tangent_at(sets, q, F, A)) return false;
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
