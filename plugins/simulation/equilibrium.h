// Equilibria of a batch of lanes: minimises Pi of every lane at once, ends on a residual criterion.
//
// Quasi-Newton (L-BFGS) per lane with one shared Cholesky factorisation of the tangent as initial metric:
//     p_l = -H_l g_l,   H_l from the lane's last m pairs (lane_history.h), H_0 = K^-1 shared by all lanes and
//     by successive calls (metric_solver.h), corrected for each lane's own parameters (group_correction.h)
// All lanes go through the mesh and the factor together. The metric is in single precision, potential,
// residual and positions in double. When iterations grow, K is factorised again in the background
// (shared_metric.h), with inertia at once; a lane that still does not converge is finished by plain Newton
// with its own tangent.
// Nocedal & Wright, Numerical Optimization, algorithms 7.4 and 3.1; Liu, Bouaziz, Kavan, ToG 36(3), 2017.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "plugins/simulation/system.h"

namespace teres {

struct EquilibriumSettings {
    double relative_residual = 1e-6;  ///< |g| <= relative_residual * force scale of the lane
    int min_iterations = 0;           ///< even if the start value has converged: soft modes move under small residuals
    int max_iterations = 60;          ///< of the quasi-Newton
    int refactorise_after = 12;       ///< iterations in one call above which K is factorised anew at once
    int renew_after = 9;              ///< ... above which it is renewed in the background
    int renewal_steps = 6;            ///< calls after which a renewal is taken over; 0: none in the background
    int max_newton_iterations = 30;   ///< of the plain Newton that finishes a lane
    int newton_budget = 0;            ///< steps of the plain Newton of all lanes in one call; 0: any number
    bool plain_newton = false;        ///< every lane alone, full Newton, direct solve (the reference path)
};

struct EquilibriumReport {
    int lanes_converged = 0;
    int iterations = 0;    ///< of the slowest lane
    int newton_lanes = 0;  ///< lanes finished by plain Newton
    int newton_steps = 0;  ///< of all of them
    int factorisations = 0;
    double relative_residual = 0.0;  ///< largest
};

/// Where the time of all calls so far went [s].
struct SolverTimes {
    double gradient = 0.0;    ///< potential and its gradient
    double metric = 0.0;      ///< triangular solves
    double correction = 0.0;  ///< of the metric for the lanes' own parameters
    double history = 0.0;     ///< L-BFGS
    double factorise = 0.0;   ///< tangent, factorisation, renewal of the metric
    double newton = 0.0;      ///< plain Newton
};

class EquilibriumSolver {
  public:
    /// [setup] All workspaces for up to max_lanes are allocated here.
    EquilibriumSolver(const MechanicalSystem& system, EquilibriumSettings settings, std::size_t max_lanes);
    ~EquilibriumSolver();

    /// [loop] x (batch layout, stride = padded_lanes(lanes)) holds start values and receives the equilibria;
    /// theta: parameter p of lane l at p * stride + l. A lane that does not converge keeps its best iterate.
    EquilibriumReport solve(const ExternalActions& actions, const Inertia& inertia, const double* theta, double* x,
                            std::size_t lanes) noexcept;

    const SolverTimes& times() const { return times_; }

    /// [loop] Before the system changes: no thread in the background looks at it any more.
    void release_system() noexcept;
    /// [loop] After a change of the system with its pattern kept, or of the step: the next call begins with a
    /// factorisation.
    void follow_system() noexcept;

  private:
    struct Workspace;
    const MechanicalSystem& system_;
    EquilibriumSettings settings_;
    std::unique_ptr<Workspace> w_;
    SolverTimes times_;

    struct Batch {
        const double* theta;
        double* x;
        Inertia inertia;
        std::size_t lanes, stride;
    };
    void iterate(const ExternalActions&, const Batch&, EquilibriumReport&) noexcept;
    void mean_state(const Batch&) noexcept;
    bool renews_in_background(const Inertia&) const noexcept;
    void follow_renewal(const ExternalActions&, const Batch&, EquilibriumReport&) noexcept;
    void line_search(const ExternalActions&, const Batch&) noexcept;
    double force_scale(const ExternalActions&) const noexcept;
    bool factorise(const ExternalActions&, const Batch&, EquilibriumReport&) noexcept;
    bool newton(const ExternalActions&, const Inertia&, const double* theta, double* x, std::size_t lane,
                std::size_t stride, EquilibriumReport&) noexcept;
};

}  // namespace teres
