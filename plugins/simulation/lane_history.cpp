#include "plugins/simulation/lane_history.h"

#include <algorithm>
#include <cmath>

#include "plugins/simulation/body.h"
#include "plugins/simulation/lane_history_kernels.h"
#include "plugins/simulation/metric_solver.h"

namespace teres {

LaneHistory::LaneHistory(std::vector<std::int32_t> dof, std::size_t storage_rows, std::size_t max_lanes, TaskTeam& team)
    : dof_(std::move(dof)), team_(team) {
    const std::size_t lanes = std::max(padded_lanes(max_lanes), MetricSolver::lane_stride(max_lanes));
    direction_.assign(storage_rows * lanes, 0.0f);
    for (std::size_t k = 0; k < kPairs; ++k) {
        s_[k].assign(dof_.size() * lanes, 0.0f);
        y_[k].assign(dof_.size() * lanes, 0.0f);
    }
    coefficients_.assign(kPairs * lanes, 0.0f);
    partial_.assign(static_cast<std::size_t>(team.threads()) * kPairs * lanes, 0.0);
    for (auto* v : {&sg_, &yr_, &alpha_, &old_sg_}) v->assign(kPairs * lanes, 0.0);
    sy_.assign(kPairs * kPairs * lanes, 0.0);
    valid_.assign(kPairs * lanes, 0);
    slope_.assign(lanes, 0.0);
    step_.assign(lanes, 0.0);
    norms_.assign(lanes, 0.0);
}

void LaneHistory::start(std::size_t stride, std::size_t float_stride) noexcept {
    stride_ = stride;
    float_stride_ = float_stride;
    count_ = 0;
    newest_ = 0;
    newest_open_ = false;
    std::fill(valid_.begin(), valid_.end(), 0);
    std::fill(direction_.begin(), direction_.end(), 0.0f);  // padding lanes stay zero
}

void LaneHistory::resume(std::size_t stride, std::size_t float_stride) noexcept {
    if (stride != stride_ || float_stride != float_stride_) {
        start(stride, float_stride);
        return;
    }
    if (!newest_open_) return;
    const float* pairs[kPairs];
    for (std::size_t age = 0; age < count_; ++age) pairs[age] = s(age);
    team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
        project({dof_.data(), first, last, stride_, float_stride_}, pairs, count_, y(0),
                &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
    });
    collect(sg_, count_);
    for (std::size_t age = 0; age < count_; ++age)
        for (std::size_t l = 0; l < stride_; ++l) sy(slot(age), slot(0), l) = sg_[age * stride_ + l];
    close_newest();
}

// A pair without positive curvature is of no use.
void LaneHistory::close_newest() noexcept {
    newest_open_ = false;
    for (std::size_t l = 0; l < stride_; ++l)
        if (valid_[slot(0) * stride_ + l] && !(sy(slot(0), slot(0), l) > 0.0)) forget(l);
}

void LaneHistory::forget(std::size_t lane) noexcept {
    for (std::size_t k = 0; k < kPairs; ++k) valid_[k * stride_ + lane] = 0;
}

// Adds up what the threads found, in their order.
void LaneHistory::collect(std::vector<double>& sums, std::size_t count) noexcept {
    const auto threads = static_cast<std::size_t>(team_.threads());
    for (std::size_t k = 0; k < count; ++k)
        for (std::size_t l = 0; l < stride_; ++l) {
            double sum = 0.0;
            for (std::size_t t = 0; t < threads; ++t) sum += partial_[(t * kPairs + k) * float_stride_ + l];
            sums[k * stride_ + l] = sum;
        }
}

void LaneHistory::norms(const double* gradient, double* out) noexcept {
    team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
        square({dof_.data(), first, last, stride_, float_stride_}, gradient,
               &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
    });
    collect(norms_, 1);
    for (std::size_t l = 0; l < stride_; ++l) out[l] = std::sqrt(norms_[l]);
}

void LaneHistory::begin(const double* gradient) noexcept {
    const float* pairs[kPairs];
    for (std::size_t age = 0; age < count_; ++age) pairs[age] = s(age);
    team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
        gather_and_project({dof_.data(), first, last, stride_, float_stride_}, gradient, pairs, count_,
                           direction_.data(), &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
    });
    collect(sg_, count_);
    if (newest_open_) {
        for (std::size_t age = 0; age < count_; ++age)  // s_i.y_newest = s_i.g - s_i.g_old
            for (std::size_t l = 0; l < stride_; ++l)
                sy(slot(age), slot(0), l) =
                    sg_[age * stride_ + l] - (age == 0 ? -step_[l] * slope_[l] : old_sg_[slot(age) * stride_ + l]);
        close_newest();
    }
    for (std::size_t age = 0; age < count_; ++age)
        for (std::size_t l = 0; l < stride_; ++l) {
            double a = sg_[age * stride_ + l];
            old_sg_[slot(age) * stride_ + l] = a;
            for (std::size_t newer = 0; newer < age; ++newer)
                a -= alpha_[newer * stride_ + l] * sy(slot(age), slot(newer), l);
            a = valid_[slot(age) * stride_ + l] ? a / sy(slot(age), slot(age), l) : 0.0;
            alpha_[age * stride_ + l] = a;
            coefficients_[age * float_stride_ + l] = static_cast<float>(-a);
        }
    if (count_ == 0) return;
    for (std::size_t age = 0; age < count_; ++age) pairs[age] = y(age);
    team_.split(dof_.size(), [&](int, std::size_t first, std::size_t last) {
        combine({dof_.data(), first, last, stride_, float_stride_}, pairs, coefficients_.data(), count_,
                direction_.data());
    });
}

void LaneHistory::finish(const double* gradient, const double* x, const double* step, double* trial,
                         double* slope) noexcept {
    if (count_ > 0) {
        const float* pairs[kPairs];
        for (std::size_t age = 0; age < count_; ++age) pairs[age] = y(age);
        team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
            project({dof_.data(), first, last, stride_, float_stride_}, pairs, count_, direction_.data(),
                    &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
        });
        collect(yr_, count_);
        for (std::size_t l = 0; l < stride_; ++l)
            for (std::size_t age = count_; age-- > 0;) {
                double b = yr_[age * stride_ + l];
                for (std::size_t older = age + 1; older < count_; ++older)
                    b += alpha_[older * stride_ + l] * sy(slot(older), slot(age), l);
                b = valid_[slot(age) * stride_ + l] ? b / sy(slot(age), slot(age), l) : 0.0;
                alpha_[age * stride_ + l] -= b;  // now alpha - beta
                coefficients_[age * float_stride_ + l] = static_cast<float>(alpha_[age * stride_ + l]);
            }
        for (std::size_t age = 0; age < count_; ++age) pairs[age] = s(age);
        team_.split(dof_.size(), [&](int, std::size_t first, std::size_t last) {
            combine({dof_.data(), first, last, stride_, float_stride_}, pairs, coefficients_.data(), count_,
                    direction_.data());
        });
    }
    team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
        take_step({dof_.data(), first, last, stride_, float_stride_}, gradient, x, direction_.data(), step, trial,
                  &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
    });
    collect(slope_, 1);
    std::copy_n(slope_.begin(), stride_, slope);
}

void LaneHistory::retry(const double* x, const double* step, double* trial) noexcept {
    team_.split(dof_.size(), [&](int rank, std::size_t first, std::size_t last) {
        take_step({dof_.data(), first, last, stride_, float_stride_}, x, x, direction_.data(), step, trial,
                  &partial_[static_cast<std::size_t>(rank) * kPairs * float_stride_]);
    });
}

void LaneHistory::accept(const double* trial, const double* trial_gradient, const double* step, const char* keep,
                         double* x, double* gradient) noexcept {
    newest_ = (newest_ + 1) % kPairs;
    count_ = std::min(count_ + 1, kPairs);
    newest_open_ = true;
    float* new_s = s_[newest_].data();
    float* new_y = y_[newest_].data();
    team_.split(dof_.size(), [&](int, std::size_t first, std::size_t last) {
        record_pair({dof_.data(), first, last, stride_, float_stride_}, trial, trial_gradient, direction_.data(), step,
                    keep, x, gradient, new_s, new_y);
    });
    for (std::size_t l = 0; l < stride_; ++l) {
        valid_[newest_ * stride_ + l] = keep[l];
        step_[l] = step[l];
    }
}

}  // namespace teres
