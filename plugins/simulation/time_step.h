// One implicit step of the batch: the incremental potential of the step, minimised by the equilibrium solver.
//
//   M a + (rM M + rK K) v + f_int(x) = f(t),      a, v of the scheme as affine functions of the new x
//
//   implicit Euler       v' = (x' - x)/h, a' = (v' - v)/h                       first order, damps strongly
//   generalised alpha    Chung & Hulbert 1993, spectral radius rho at infinity    second order, low
//   dissipation
//       alpha_m = (2 rho - 1)/(rho + 1), alpha_f = rho/(rho + 1), gamma = 1/2 - alpha_m + alpha_f,
//       beta = (1 - alpha_m + alpha_f)^2/4; unknown y = (1 - alpha_f) x' + alpha_f x
//
// K of the damping is the tangent at the start of the step (per lane), so that a rigid rotation is not
// damped.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "plugins/simulation/equilibrium.h"
#include "plugins/simulation/subspace_solver.h"
#include "plugins/simulation/system.h"

namespace teres {

enum class TimeScheme { kQuasiStatic, kImplicitEuler, kGeneralisedAlpha };

/// Equal parts that a step is walked in, none longer than `longest_s`; 1000 at most, so that a pause cannot hold up a
/// loop.
int parts_of_step(double length_s, double longest_s);

struct TimeStepSettings {
    TimeScheme scheme = TimeScheme::kGeneralisedAlpha;
    double spectral_radius = 0.9;
    double rayleigh_mass_1_s = 0.0;
    double rayleigh_stiffness_s = 0.0;
    /// Longer steps are walked in equal parts: generalised alpha gains energy where a body swings far in one step.
    double max_step_s = std::numeric_limits<double>::infinity();
};

/// Blocks of state rows: positions, velocities (dynamic), accelerations (generalised alpha).
std::size_t state_blocks(TimeScheme scheme);

class TimeStepper {
  public:
    /// [setup]
    TimeStepper(const MechanicalSystem& system, EquilibriumSolver& solver, TimeStepSettings settings,
                std::size_t max_lanes);

    /// [loop] state: batch layout, state_blocks * 3N rows; advanced by dt_s under the actions at the end of
    /// the step; dead loads change evenly during it. A part in which a lane does not converge is halved, three times at
    /// most, unless the part before did not converge even so.
    EquilibriumReport step(const ExternalActions& actions, double dt_s, const double* theta, double* state,
                           std::size_t lanes) noexcept;

    /// [loop] Replaces TimeStepSettings::rayleigh_mass_1_s.
    void set_rayleigh_mass(double rate_1_s) { settings_.rayleigh_mass_1_s = rate_1_s; }
    /// [loop] One lane steps in a subspace from now on; null: in all of the mesh again.
    void reduce_to(SubspaceSolver* subspace) { subspace_ = subspace; }
    /// [loop] The next step begins a motion of its own: no load before it is remembered.
    void restart() {
        last_force_n_.resize(0);
        holds_ = true;
    }
    /// alpha_f: the equations of a step hold at (1 - alpha_f) of it.
    double alpha_f() const;

  private:
    struct Start {
        std::vector<double> state;
        Eigen::VectorXd last_force_n;
        ExternalActions middle;
    };
    /// In one step or, if a lane does not converge, in two halves; these in halves as long as `starts` are left. What
    /// others set for the length of the step (viscous memory) stays as it is.
    EquilibriumReport step_or_halve(const ExternalActions& actions, double dt_s, const double* theta, double* state,
                                    std::size_t lanes, std::span<Start> starts) noexcept;
    EquilibriumReport step_at_once(const ExternalActions& actions, double dt_s, const double* theta, double* state,
                                   std::size_t lanes) noexcept;

    const MechanicalSystem& system_;
    EquilibriumSolver& solver_;
    TimeStepSettings settings_;
    SubspaceSolver* subspace_ = nullptr;
    double last_dt_s_ = 0.0;
    ExternalActions at_alpha_, at_part_;
    Eigen::VectorXd first_force_n_, last_force_n_;
    std::vector<Start> starts_;  // one per halving
    bool holds_ = true;          // every lane converged last
    std::vector<double> target_, y_, velocity_target_;
    StiffnessDamping damping_;
    Positions positions_;
    std::vector<double> theta_one_;
};

}  // namespace teres
