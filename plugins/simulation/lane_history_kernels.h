// Inner loops of LaneHistory: rows [first, last) of one thread, all lanes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace teres {

struct LaneRows {
    const std::int32_t* dof;
    std::size_t first, last;  ///< rows
    std::size_t stride;       ///< of batch arrays (double)
    std::size_t float_stride;
};

/// q = g; sums[k * float_stride + l] = s_k.g
void gather_and_project(const LaneRows& rows, const double* g, const float* const* s, std::size_t count, float* q,
                        double* sums) noexcept;
/// sums[k * float_stride + l] = v_k.q
void project(const LaneRows& rows, const float* const* v, std::size_t count, const float* q, double* sums) noexcept;
/// q += sum_k c[k * float_stride + l] v_k
void combine(const LaneRows& rows, const float* const* v, const float* c, std::size_t count, float* q) noexcept;
/// sums[l] = g.g
void square(const LaneRows& rows, const double* g, double* sums) noexcept;
/// trial = x - step d; sums[l] = g.d
void take_step(const LaneRows& rows, const double* g, const double* x, const float* d, const double* step,
               double* trial, double* sums) noexcept;
/// s = -step d, y = trial_g - g, x = trial, g = trial_g for kept lanes; s = y = 0 for the others
void record_pair(const LaneRows& rows, const double* trial, const double* trial_g, const float* d, const double* step,
                 const char* keep, double* x, double* g, float* s, float* y) noexcept;

}  // namespace teres
