// One lane's step in a subspace of motions: x = x_0 + Phi q minimises the potential that the equilibrium solver
// minimises,
//
//     r = Phi^T g(x),   q <- q - H r,   H: BFGS matrix from (Phi^T K Phi)^-1, kept from step to step
//
// (Nocedal & Wright, Numerical Optimization, 6.1). Forces are those of the whole mesh, whatever law and supports: only
// the solve is reduced. Ends when |r| <= relative_residual * |applied force|. What Phi leaves out is an error of the
// motion that a simulation of the whole mesh shows.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "plugins/simulation/equilibrium.h"

namespace teres {

class SubspaceSolver {
  public:
    /// [setup] columns: 3 per node, zero on held nodes; dependent ones are left out.
    SubspaceSolver(const MechanicalSystem& system, const EquilibriumSettings& settings, const Eigen::MatrixXd& columns);

    /// [loop] x: batch layout of one lane, start value and result.
    EquilibriumReport solve(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                            double* x) noexcept;
    /// [loop] v <- Phi Phi^T v (3 per node).
    void project(double* v) const noexcept;
    Eigen::Index dimension() const { return basis_.cols(); }

  private:
    bool start_metric(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                      const double* x) noexcept;
    double evaluate(const ExternalActions& actions, const Inertia& inertia, const double* theta, const double* x,
                    Eigen::VectorXd& r) noexcept;

    const MechanicalSystem& system_;
    double relative_residual_;
    int max_iterations_;
    Eigen::MatrixXd basis_, H_;
    double coefficient_ = -1.0;  // of the inertia that H_ was made with
    Eigen::VectorXd r_, trial_r_, dq_, y_, Hy_, move_, full_;
    std::vector<double> x_, gradient_, energy_, theta_one_, values_;
};

}  // namespace teres
