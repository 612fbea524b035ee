// Inner loops of the metric: triangular solves of panels and dense low-rank updates, SIMD lane = lane of the
// batch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "plugins/simulation/metric_solver.h"

namespace teres {

/// L y = y over the panels in order, lanes [first_lane, first_lane + lanes): one, or a multiple of 4.
void solve_lower(const std::vector<MetricSolver::Panel>& panels, const std::int32_t* rows, const float* values,
                 float* y, std::size_t stride, std::size_t first_lane, std::size_t lanes) noexcept;
/// L^T y = y over the panels in reverse order.
void solve_upper(const std::vector<MetricSolver::Panel>& panels, const std::int32_t* rows, const float* values,
                 float* y, std::size_t stride, std::size_t first_lane, std::size_t lanes) noexcept;
/// y -= W c for rows [first, last): W has `modes` columns, rows W_stride apart; c has modes x stride values.
void subtract_product(const float* W, const float* c, float* y, std::size_t first, std::size_t last, std::size_t modes,
                      std::size_t W_stride, std::size_t stride) noexcept;

}  // namespace teres
