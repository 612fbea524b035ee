#include "plugins/simulation/shared_metric.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>

namespace teres {

SharedMetric::SharedMetric(const MechanicalSystem& system, std::size_t max_lanes)
    : system_(system),
      cholesky_(system.pattern()),
      solver_(cholesky_, system.team().threads()),
      correction_(system.parts().tethers, system.parts().num_parameters, system.pattern(), solver_, max_lanes) {
    if (max_lanes == 1) rotation_.emplace(system.pattern(), system.num_nodes(), solver_);
    values_.reserve(system.pattern().num_values());
}

bool SharedMetric::read(const ExternalActions& actions, const Inertia& inertia, std::size_t lane, const double* theta,
                        const Positions& x) noexcept {
    usable_ = false;
    if (!system_.tangent(actions, inertia, lane, theta, x, values_)) return false;
    correction_.read(system_.parts().tethers, theta, x);
    if (rotation_) rotation_->read(x);
    return true;
}

bool SharedMetric::factorise(TaskTeam& team, int& factorisations) noexcept {
    if (!cholesky_.factorise_shifted(values_, factorisations)) return false;
    solver_.renew(cholesky_);
    if (!rotation_) correction_.renew(solver_, team);  // a lane of its own is where the metric is made, at first
    usable_ = true;
    return true;
}

void SharedMetric::set_lanes(const double* theta, const double* x, std::size_t stride, std::size_t lanes) noexcept {
    correction_.set_lanes(theta, stride, lanes, solver_, system_.team());
    if (rotation_) rotation_->follow(x, stride);
}

void SharedMetric::solve(float* y, std::size_t lanes, std::size_t open) noexcept {
    if (rotation_) rotation_->turn_back(y, MetricSolver::lane_stride(lanes));
    solver_.solve(y, lanes, open, system_.team());
}

void SharedMetric::correct(float* y, std::size_t lanes, std::size_t open) noexcept {
    correction_.apply(y, lanes, open, system_.team());
    if (rotation_) rotation_->turn(y, MetricSolver::lane_stride(lanes));
}

MetricRenewal::MetricRenewal(const MechanicalSystem& system, std::size_t max_lanes)
    : system_(system),
      spare_(std::make_unique<SharedMetric>(system, max_lanes)),
      alone_(TaskTeam::on_caller(system.team().threads())),
      theta_(std::max<std::size_t>(1, system.parts().num_parameters), 0.0),
      x_(3, static_cast<Eigen::Index>(system.num_nodes())),
      thread_([this] { work(); }) {}

MetricRenewal::~MetricRenewal() {
    {
        const std::lock_guard lock(mutex_);
        stop_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

void MetricRenewal::begin(const ExternalActions& actions, const double* theta, const Positions& x) {
    actions_ = actions;
    std::copy_n(theta, theta_.size(), theta_.begin());
    x_ = x;
    running_ = true;
    outdated_ = false;
    {
        const std::lock_guard lock(mutex_);
        wanted_ = true;
        read_ = done_ = false;
    }
    changed_.notify_all();
}

void MetricRenewal::release_system() {
    if (!running_) return;
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return read_; });
    outdated_ = true;
}

bool MetricRenewal::take(std::unique_ptr<SharedMetric>& metric, int& factorisations) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return done_; });
    running_ = false;
    factorisations += factorisations_;
    if (!ok_ || outdated_) return false;
    metric.swap(spare_);
    return true;
}

namespace {

// The step goes first, the calling thread takes what it leaves (Linux: a priority for each thread).
void step_back() {
    constexpr int kNicer = 10;
    setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kNicer);
}

}  // namespace

void MetricRenewal::work() {
    step_back();
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return wanted_ || stop_; });
        if (stop_) return;
        wanted_ = false;
        lock.unlock();
        factorisations_ = 0;
        ok_ = spare_->read(actions_, {}, 0, theta_.data(), x_);
        lock.lock();
        read_ = true;
        lock.unlock();
        changed_.notify_all();
        ok_ = ok_ && spare_->factorise(alone_, factorisations_);
        lock.lock();
        done_ = true;
        changed_.notify_all();
    }
}

}  // namespace teres
