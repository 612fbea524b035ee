#include "plugins/simulation/point_shares.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <span>

namespace teres {
namespace {

void bisect(const Positions& X, std::span<NodeIndex> nodes, int first, int threads, std::vector<int>& owner) {
    if (threads == 1) {
        for (const auto n : nodes) owner[static_cast<std::size_t>(n)] = first;
        return;
    }
    Eigen::Vector3d low = X.col(nodes[0]), high = low;
    for (const auto n : nodes) {
        low = low.cwiseMin(X.col(n));
        high = high.cwiseMax(X.col(n));
    }
    Eigen::Index axis;
    (high - low).maxCoeff(&axis);
    const int left = threads / 2;
    const auto middle = nodes.size() * static_cast<std::size_t>(left) / static_cast<std::size_t>(threads);
    std::nth_element(
        nodes.begin(), nodes.begin() + static_cast<std::ptrdiff_t>(middle), nodes.end(),
        [&](NodeIndex a, NodeIndex b) { return X(axis, a) != X(axis, b) ? X(axis, a) < X(axis, b) : a < b; });
    bisect(X, nodes.first(middle), first, left, owner);
    bisect(X, nodes.subspan(middle), first + left, threads - left, owner);
}

}  // namespace

PointShares::PointShares(const std::vector<StrainPoints>& points, const Positions& X, int threads) {
    const auto num_nodes = static_cast<std::size_t>(X.cols()), ranks = static_cast<std::size_t>(threads);
    std::vector<int> owner(num_nodes, 0);
    std::vector<NodeIndex> nodes(num_nodes);
    std::iota(nodes.begin(), nodes.end(), 0);
    if (num_nodes >= ranks) bisect(X, nodes, 0, threads, owner);

    std::vector<std::map<NodeIndex, std::int32_t>> spare(ranks);  // row within the thread's spares
    for (const auto& set : points) {
        auto& shares = sets_.emplace_back();
        std::vector<std::vector<std::int32_t>> of_rank(ranks);
        shares.row.resize(set.node.size());
        for (std::size_t q = 0; q < set.size(); ++q) {
            std::vector<int> votes(ranks, 0);
            for (auto i = set.offset[q]; i < set.offset[q + 1]; ++i)
                ++votes[static_cast<std::size_t>(
                    owner[static_cast<std::size_t>(set.node[static_cast<std::size_t>(i)])])];
            const auto rank = static_cast<std::size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
            of_rank[rank].push_back(static_cast<std::int32_t>(q));
            for (auto i = set.offset[q]; i < set.offset[q + 1]; ++i) {
                const auto k = static_cast<std::size_t>(i);
                const bool own = owner[static_cast<std::size_t>(set.node[k])] == static_cast<int>(rank);
                shares.row[k] = own ? set.node[k]  // spares are counted per thread until all are known
                                    : ~spare[rank]
                                           .try_emplace(set.node[k], static_cast<std::int32_t>(spare[rank].size()))
                                           .first->second;
            }
        }
        for (const auto& share : of_rank) {
            shares.first.push_back(shares.point.size());
            shares.point.insert(shares.point.end(), share.begin(), share.end());
        }
        shares.first.push_back(shares.point.size());
    }
    for (std::size_t rank = 0; rank < ranks; ++rank) {
        spare_first_.push_back(spare_node_.size());
        std::vector<NodeIndex> node(spare[rank].size());
        for (const auto& [n, row] : spare[rank]) node[static_cast<std::size_t>(row)] = n;
        spare_node_.insert(spare_node_.end(), node.begin(), node.end());
    }
    spare_first_.push_back(spare_node_.size());
    for (std::size_t set = 0; set < sets_.size(); ++set)
        for (std::size_t rank = 0; rank < ranks; ++rank)
            for (auto k = sets_[set].first[rank]; k < sets_[set].first[rank + 1]; ++k) {
                const auto q = static_cast<std::size_t>(sets_[set].point[k]);
                for (auto i = points[set].offset[q]; i < points[set].offset[q + 1]; ++i)
                    if (auto& row = sets_[set].row[static_cast<std::size_t>(i)]; row < 0)
                        row = ~(~row + static_cast<std::int32_t>(spare_first_[rank]));
            }
}

void PointShares::add_spares(const double* spare, double* gradient, std::size_t stride) const noexcept {
    for (std::size_t k = 0; k < spare_node_.size(); ++k) {
        double* to = gradient + 3 * static_cast<std::size_t>(spare_node_[k]) * stride;
        const double* from = spare + 3 * k * stride;
        for (std::size_t i = 0; i < 3 * stride; ++i) to[i] += from[i];
    }
}

}  // namespace teres
