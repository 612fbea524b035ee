// Which thread evaluates which strain points, so that no two threads ever write to the same row.
//
// Nodes are split between the threads by place (halves of equal number along the longest axis, again and
// again), a point goes to the owner of most of its nodes. What a thread adds to a node of another owner goes
// to a spare row of its own; add_spares() sums them afterwards, always in the same order.
#pragma once

#include <cstdint>
#include <vector>

#include "plugins/simulation/strain_points.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

class PointShares {
  public:
    /// [setup]
    PointShares() = default;
    PointShares(const std::vector<StrainPoints>& points, const Positions& X, int threads);

    struct Points {                       ///< of one set of strain points
        std::vector<std::int32_t> point;  ///< by thread
        std::vector<std::size_t> first;   ///< threads + 1
        std::vector<std::int32_t> row;    ///< node that each node entry is added to, or ~spare row
    };
    const Points& points(std::size_t set) const { return sets_[set]; }
    std::size_t num_spare_rows() const { return spare_node_.size(); }
    /// Spare rows of one thread: [spare_begin(rank), spare_begin(rank + 1)).
    std::size_t spare_begin(int rank) const { return spare_first_[static_cast<std::size_t>(rank)]; }
    /// [loop] Adds the spare rows to those of their nodes (each of 3 x stride).
    void add_spares(const double* spare, double* gradient, std::size_t stride) const noexcept;

  private:
    std::vector<Points> sets_;
    std::vector<NodeIndex> spare_node_;
    std::vector<std::size_t> spare_first_;
};

}  // namespace teres
