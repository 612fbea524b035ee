#include "plugins/simulation/block_pattern.h"

#include <algorithm>

#include "core/check.h"

namespace teres {

BlockPattern BlockPattern::make(const std::vector<std::set<NodeIndex>>& neighbours, const std::vector<char>& held) {
    BlockPattern p;
    p.free_of_node_.assign(neighbours.size(), -1);
    for (std::size_t a = 0; a < neighbours.size(); ++a)
        if (!held[a]) p.free_of_node_[a] = p.num_free_++;
    p.block_start_.push_back(0);
    for (std::size_t a = 0; a < neighbours.size(); ++a) {
        if (held[a]) continue;
        const std::int32_t column = p.free_of_node_[a];
        p.block_row_.push_back(column);
        for (const auto b : neighbours[a])  // std::set: ascending, and free indices ascend with nodes
            if (p.free_of_node_[static_cast<std::size_t>(b)] > column)
                p.block_row_.push_back(p.free_of_node_[static_cast<std::size_t>(b)]);
        p.block_start_.push_back(static_cast<std::int32_t>(p.block_row_.size()));
    }
    p.column_start_.push_back(0);
    for (std::int32_t column = 0; column < p.num_free_; ++column) {
        const auto first = p.block_start_[static_cast<std::size_t>(column)];
        const auto last = p.block_start_[static_cast<std::size_t>(column) + 1];
        for (int c = 0; c < 3; ++c) {
            for (int r = c; r < 3; ++r) p.row_.push_back(3 * column + r);
            for (auto k = first + 1; k < last; ++k)
                for (int r = 0; r < 3; ++r) p.row_.push_back(3 * p.block_row_[static_cast<std::size_t>(k)] + r);
            p.column_start_.push_back(static_cast<std::int32_t>(p.row_.size()));
        }
    }
    return p;
}

std::int32_t BlockPattern::block(NodeIndex a, NodeIndex b) const {
    const auto fa = free_index(a), fb = free_index(b);
    if (fa < 0 || fb < 0) return -1;
    const auto column = static_cast<std::size_t>(std::min(fa, fb));
    const auto row = std::max(fa, fb);
    const auto first = block_row_.begin() + block_start_[column], last = block_row_.begin() + block_start_[column + 1];
    const auto found = std::lower_bound(first, last, row);
    TERES_CHECK(found != last && *found == row);
    return static_cast<std::int32_t>(found - block_row_.begin());
}

void BlockPattern::add(NodeIndex a, NodeIndex b, std::int32_t block, const Eigen::Matrix3d& K,
                       std::vector<double>& values) const {
    if (block < 0) return;
    const auto fa = free_index(a), fb = free_index(b);
    const auto column = std::min(fa, fb);
    const auto k = block - block_start_[static_cast<std::size_t>(column)];
    for (int c = 0; c < 3; ++c) {
        double* v = values.data() + column_start_[static_cast<std::size_t>(3 * column + c)];
        if (fa == fb) {
            for (int r = c; r < 3; ++r) v[r - c] += K(r, c);
        } else {
            v += (3 - c) + 3 * (k - 1);
            // The stored block couples rows of the larger index to columns of the smaller one.
            for (int r = 0; r < 3; ++r) v[r] += fa > fb ? K(r, c) : K(c, r);
        }
    }
}

void BlockPattern::multiply(const std::vector<double>& values, const double* x, double* y) const {
    const auto rows = static_cast<std::size_t>(num_rows());
    for (std::size_t j = 0; j < rows; ++j) {
        const auto first = static_cast<std::size_t>(column_start_[j]),
                   last = static_cast<std::size_t>(column_start_[j + 1]);
        double sum = values[first] * x[j];
        const double xj = x[j];
        for (auto k = first + 1; k < last; ++k) {
            const auto i = static_cast<std::size_t>(row_[k]);
            y[i] += values[k] * xj;
            sum += values[k] * x[i];
        }
        y[j] += sum;
    }
}

BlockPattern::Rows BlockPattern::multiply(const std::vector<double>& values, const Rows& X) const {
    Rows Y = Rows::Zero(X.rows(), X.cols());
    for (Eigen::Index j = 0; j < X.rows(); ++j) {
        const auto first = column_start_[static_cast<std::size_t>(j)],
                   last = column_start_[static_cast<std::size_t>(j) + 1];
        for (auto k = static_cast<std::size_t>(first); k < static_cast<std::size_t>(last); ++k) {
            const Eigen::Index i = row_[k];
            Y.row(i) += values[k] * X.row(j);
            if (i != j) Y.row(j) += values[k] * X.row(i);
        }
    }
    return Y;
}

}  // namespace teres
