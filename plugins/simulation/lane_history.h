// L-BFGS for a batch of lanes: two-loop recursion with every lane's own coefficients, vectors in single
// precision.
//
//   q = g - sum_i alpha_i y_i,   r = K^-1 q,   d = r + sum_i (alpha_i - beta_i) s_i
//   alpha_i = rho_i (s_i.g - sum_{j newer} alpha_j s_i.y_j),   beta_i = rho_i (y_i.r + sum_{j older} c_j
//   s_j.y_i)
//
// with pairs s = x' - x, y = g' - g, rho = 1/(s.y) (Nocedal & Wright, algorithm 7.4). All inner products of a
// loop are taken in one pass over memory; the products s_i.y_j of old with new pairs follow from s_i.g at two
// iterates.
//
// Rows are those of the metric (metric_solver.h): row r belongs to degree of freedom dof[r] of the batch
// arrays.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "plugins/simulation/task_team.h"

namespace teres {

class LaneHistory {
  public:
    static constexpr std::size_t kPairs = 8;

    /// [setup] dof: row of the batch arrays for each row of the metric.
    LaneHistory(std::vector<std::int32_t> dof, std::size_t storage_rows, std::size_t max_lanes, TaskTeam& team);

    /// [loop] Starts a new sequence; stride of the batch arrays and of the single-precision vectors.
    void start(std::size_t stride, std::size_t float_stride) noexcept;
    /// [loop] Goes on with the pairs of the last sequence (loads and parameters have moved a little: the
    /// curvature they tell of has not); starts anew if the strides differ.
    void resume(std::size_t stride, std::size_t float_stride) noexcept;
    /// [loop] Forgets one lane's pairs.
    void forget(std::size_t lane) noexcept;

    /// [loop] direction = q; gradient in batch layout.
    void begin(const double* gradient) noexcept;
    /// [loop] From direction = r: direction = d, slope = g.d per lane, trial = x - step d (step per lane).
    void finish(const double* gradient, const double* x, const double* step, double* trial, double* slope) noexcept;
    /// [loop] trial = x - step d again, after steps were shortened.
    void retry(const double* x, const double* step, double* trial) noexcept;
    /// [loop] Stores the pair of the accepted step, x = trial, gradient = trial_gradient for lanes with
    /// keep[l] != 0.
    void accept(const double* trial, const double* trial_gradient, const double* step, const char* keep, double* x,
                double* gradient) noexcept;

    /// [loop] out[l] = |g| of every lane.
    void norms(const double* gradient, double* out) noexcept;

    float* direction() { return direction_.data(); }

  private:
    const float* s(std::size_t age) const { return s_[slot(age)].data(); }
    const float* y(std::size_t age) const { return y_[slot(age)].data(); }
    std::size_t slot(std::size_t age) const { return (newest_ + kPairs - age) % kPairs; }  // age 0: newest
    double& sy(std::size_t i, std::size_t j, std::size_t lane) { return sy_[(i * kPairs + j) * stride_ + lane]; }
    void close_newest() noexcept;
    void collect(std::vector<double>& sums, std::size_t count) noexcept;

    std::vector<std::int32_t> dof_;
    TaskTeam& team_;
    std::size_t stride_ = 0, float_stride_ = 0, count_ = 0, newest_ = 0;
    bool newest_open_ = false;  // products with the newest pair are not known yet
    std::vector<float> direction_, s_[kPairs], y_[kPairs], coefficients_;
    std::vector<double> partial_;          // per thread: inner products
    std::vector<double> sg_, yr_, alpha_;  // by age and lane
    std::vector<double> old_sg_;           // s_i.g of the last iterate, by slot and lane
    std::vector<double> sy_;               // s_i.y_j by slots and lane, i older than or as old as j
    std::vector<char> valid_;              // by slot and lane
    std::vector<double> slope_, step_;     // of the last step
    std::vector<double> norms_;
};

}  // namespace teres
