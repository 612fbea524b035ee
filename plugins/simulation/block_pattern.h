// Sparsity of the tangent stiffness: symmetric, 3x3 node blocks, lower triangle in compressed columns
// (CHOLMOD's form). The pattern is fixed once; assembling adds values at positions known in advance.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <set>
#include <vector>

#include "plugins/simulation/tet_mesh.h"

namespace teres {

class BlockPattern {
  public:
    /// neighbours[a]: nodes coupled to a (a itself is implied); held nodes have no rows.
    static BlockPattern make(const std::vector<std::set<NodeIndex>>& neighbours, const std::vector<char>& held);

    std::int32_t num_free_nodes() const { return num_free_; }
    Eigen::Index num_rows() const { return 3 * static_cast<Eigen::Index>(num_free_); }
    std::size_t num_values() const { return static_cast<std::size_t>(column_start_.back()); }
    /// Free index of a node, -1 if it is held.
    std::int32_t free_index(NodeIndex node) const { return free_of_node_[static_cast<std::size_t>(node)]; }
    const std::vector<std::int32_t>& column_start() const { return column_start_; }  ///< num_rows() + 1
    const std::vector<std::int32_t>& row() const { return row_; }

    /// Index of the block (row node, column node), -1 if one of them is held. Order of the two does not
    /// matter.
    std::int32_t block(NodeIndex a, NodeIndex b) const;
    /// Adds K_ab (3x3, coupling rows of a to columns of b); call once per unordered pair, with a == b the
    /// whole block.
    void add(NodeIndex a, NodeIndex b, std::int32_t block, const Eigen::Matrix3d& K, std::vector<double>& values) const;
    /// y += K x for the matrix with these values (x, y over free rows).
    void multiply(const std::vector<double>& values, const double* x, double* y) const;
    /// K X of several vectors at once.
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Rows multiply(const std::vector<double>& values, const Rows& X) const;

  private:
    std::int32_t num_free_ = 0;
    std::vector<std::int32_t> free_of_node_;
    std::vector<std::int32_t> block_start_;   // per free node: first block of its column
    std::vector<std::int32_t> block_row_;     // free node of each block, ascending, diagonal first
    std::vector<std::int32_t> column_start_;  // scalar columns
    std::vector<std::int32_t> row_;
};

}  // namespace teres
