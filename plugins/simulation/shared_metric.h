// The metric that all lanes share, and its renewal in the background.
//
// A renewal is begun with a copy of one lane's state and taken over a fixed number of steps later, whether or
// not the thread was done sooner: which step uses which factorisation does not depend on timing.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "plugins/simulation/group_correction.h"
#include "plugins/simulation/metric_rotation.h"
#include "plugins/simulation/system.h"

namespace teres {

/// Factorisation of the tangent at one state, as a metric in single precision.
class SharedMetric {
  public:
    /// [setup]
    SharedMetric(const MechanicalSystem& system, std::size_t max_lanes);

    /// [loop] Takes the tangent at `x` (lane of inertia.damping: `lane`) with parameters `theta` (one lane). False:
    /// outside of the law's domain.
    bool read(const ExternalActions& actions, const Inertia& inertia, std::size_t lane, const double* theta,
              const Positions& x) noexcept;
    /// [loop] Factorises what was read; the system may change meanwhile. Counts factorisations. False: not positive
    /// definite even when shifted.
    bool factorise(TaskTeam& team, int& factorisations) noexcept;
    bool usable() const { return usable_; }
    /// [loop] Prepares the lanes of one solve (batch layout): their parameters theta, a lane of its own also by how the
    /// body at x has turned.
    void set_lanes(const double* theta, const double* x, std::size_t stride, std::size_t lanes) noexcept;
    /// [loop] y <- K0^-1 y and then y <- K~_l^-1 r for the first `open` lanes (rows and lanes as in metric_solver.h).
    void solve(float* y, std::size_t lanes, std::size_t open) noexcept;
    void correct(float* y, std::size_t lanes, std::size_t open) noexcept;

    MetricSolver& solver() { return solver_; }

  private:
    const MechanicalSystem& system_;
    Cholesky cholesky_;
    MetricSolver solver_;
    std::optional<MetricRotation> rotation_;  // of a lane of its own
    GroupCorrection correction_;              // the lanes' own parameters in the shared metric
    std::vector<double> values_;
    bool usable_ = false;
};

class MetricRenewal {
  public:
    MetricRenewal(const MechanicalSystem& system, std::size_t max_lanes);
    ~MetricRenewal();

    bool running() const { return running_; }
    /// [loop] Begins a renewal at this state (copied).
    void begin(const ExternalActions& actions, const double* theta, const Positions& x);
    /// [loop] The system is about to change: waits until the thread has read it. What it makes of it is not taken over.
    void release_system();
    /// [loop] Waits for it and exchanges it for `metric` if it succeeded.
    bool take(std::unique_ptr<SharedMetric>& metric, int& factorisations);

  private:
    void work();

    const MechanicalSystem& system_;
    std::unique_ptr<SharedMetric> spare_;
    TaskTeam alone_;
    ExternalActions actions_;
    std::vector<double> theta_;
    Positions x_;
    bool running_ = false, ok_ = false, outdated_ = false;
    int factorisations_ = 0;
    std::mutex mutex_;
    std::condition_variable changed_;
    bool wanted_ = false, read_ = false, done_ = false, stop_ = false;  // under mutex_
    std::thread thread_;
};

}  // namespace teres
