// y <- K^-1 y for many lanes at once, in single precision: the metric of the quasi-Newton. What rounding
// leaves out costs iterations, never accuracy: the residual is always formed in double precision.
//
// The Cholesky factor is stored as panels of up to 12 columns, row by row, so that one pass streams it once
// for all lanes (lane = SIMD lane). Disjoint subtrees of the elimination tree go to different threads, the
// columns above them
// ("top") are shared between the threads by lanes. Davis, Direct Methods for Sparse Linear Systems, 2006, ch.
// 3 and 4.
//
// Vectors are in the solver's own row order: row r of the vector belongs to free row free_row(r) of the
// pattern; lane l of row r stands at r * lane_stride(lanes) + l.
#pragma once

#include <cstdint>
#include <vector>

#include "plugins/simulation/cholesky.h"
#include "plugins/simulation/task_team.h"

namespace teres {

class MetricSolver {
  public:
    /// Single-precision lanes are padded to 4, 8 or a multiple of 16.
    static std::size_t lane_stride(std::size_t lanes) {
        return lanes <= 4 ? 4 : lanes <= 8 ? 8 : (lanes + 15) / 16 * 16;
    }

    /// [setup] Takes over the structure of the analysed factor; solve() is shared by this many threads.
    MetricSolver(const Cholesky& cholesky, int threads);
    /// [loop] Takes over the values of the factor.
    void renew(const Cholesky& cholesky) noexcept;

    std::size_t num_rows() const { return free_row_.size(); }
    /// Rows that a vector must have space for (a share of the top for each thread).
    std::size_t num_storage_rows() const { return storage_rows_; }
    std::int32_t free_row(std::size_t row) const { return free_row_[row]; }
    /// [loop] In place; y has num_storage_rows() * lane_stride(lanes) values. The first `open` lanes are solved, others
    /// hold anything afterwards.
    void solve(float* y, std::size_t lanes, std::size_t open, TaskTeam& team) noexcept;
    void solve(float* y, std::size_t lanes, TaskTeam& team) noexcept { solve(y, lanes, lanes, team); }

    /// Columns [first_row, first_row + width) of the factor: a triangle (with inverse diagonal) and the rows
    /// below.
    struct Panel {
        std::int32_t first_row, width, num_below;
        std::size_t below;      ///< of rows_: storage rows of what stands below
        std::size_t triangle;   ///< of values_: width x width, row by row
        std::size_t rectangle;  ///< of values_: num_below x width, row by row
        std::size_t source;     ///< of the factor's values: first entry of the first column
        std::int32_t leading;   ///< distance between columns there
    };
    struct Share {
        std::vector<Panel> panels;  ///< children before parents
    };

  private:
    std::vector<std::int32_t> free_row_;
    std::vector<Share> shares_;  // one per thread
    Share top_;
    std::size_t top_first_ = 0, top_rows_ = 0, storage_rows_ = 0;
    std::vector<std::int32_t> rows_;
    std::vector<float> values_;
};

}  // namespace teres
