// One time step of a tetrahedral body with springs and loads, one linear solve each (no Newton iteration), as
// the recorded peer runs do it, and the static equilibrium in their sense. f(x): elastic, spring and outer
// forces; S = -df/dx at the start of the step; M: lumped mass; rM, rK: Rayleigh coefficients; h: step. Held
// nodes have no rows.
//
//   implicit Euler    ((1 + h rM) M + h (h + rK) S) dv = h (f - rM M v - (h + rK) S v);   v += dv;  x += h v
//   implicit midpoint (4/h^2 M + 4 rM/h M + (1 + 4 rK/h) S) d = f + 2/h p;   v = 2 d / h,
//                     p = M v + h/2 f(x + h/2 v),  x += h v.   p is kept between steps, M v0 at first
//   static            S d = f, x += d, repeated
//
// After an implicit step v (and p) may be multiplied by exp(-h c) (velocity damping c).
#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <memory>
#include <span>
#include <vector>

#include "core/result.h"
#include "plugins/simulation/anchor_spring.h"
#include "plugins/simulation/elastic_tets.h"

namespace teres {

/// What stays the same during a run. Shared by all steppers; immutable once made.
struct TetSystem {
    std::unique_ptr<ElasticTets> body;
    Eigen::VectorXd node_mass;               ///< per node [kg]
    std::vector<char> held;                  ///< per node: 1 does not move
    Eigen::Vector3d gravity{0.0, 0.0, 0.0};  ///< [m/s^2]
    double rayleigh_mass = 0.0;              ///< rM [1/s]
    double rayleigh_stiffness = 0.0;         ///< rK [s]
    int cg_iterations = 0;                   ///< of the implicit steps; 0: direct solve
    double cg_tolerance = 1e-20;             ///< relative to the right-hand side
    BlockPattern pattern;

    /// Builds the pattern and binds the body to it. Errors (kInvalidInput): sizes differ, a moving node
    /// without mass.
    static Result<TetSystem> make(std::unique_ptr<ElasticTets> body, const Eigen::VectorXd& node_mass,
                                  const std::vector<char>& held);
    Eigen::Index num_dofs() const { return 3 * node_mass.size(); }
};

/// What acts during one step of one simulation.
struct StepDrive {
    std::span<const double> modulus;               ///< Young's modulus per tetrahedron [Pa]
    std::span<const AnchorSpring> springs;         ///< tool springs too
    const Eigen::VectorXd* outer_force = nullptr;  ///< 3 per node [N], may be absent
};

struct MotionState {
    Eigen::VectorXd x;  ///< positions, 3 per node [m]
    Eigen::VectorXd v;  ///< velocities [m/s]
    Eigen::VectorXd p;  ///< momenta of the implicit midpoint [kg m/s]; empty: M v
};

struct StaticOptions {
    int newton_iterations = 3;
    double residual_tolerance_n = 1e-8;    ///< stop when |f| is below
    double correction_tolerance_m = 1e-8;  ///< stop when |d| is below
    int cg_iterations = 0;                 ///< 0: direct solve
    double cg_tolerance = 1e-20;           ///< relative to |f|
};

/// Work space of one thread: matrix values and factorisation. [loop] calls return false when the matrix is
/// singular.
class Stepper {
  public:
    explicit Stepper(const TetSystem& system);

    bool implicit_euler(const StepDrive& drive, double h, double velocity_damping, MotionState& state) noexcept;
    bool implicit_midpoint(const StepDrive& drive, double h, double velocity_damping, MotionState& state) noexcept;
    bool static_equilibrium(const StepDrive& drive, const StaticOptions& options, MotionState& state) noexcept;

  private:
    void forces(const StepDrive& drive, const Eigen::VectorXd& x, Eigen::VectorXd& f) const noexcept;
    void forces_and_stiffness(const StepDrive& drive, const Eigen::VectorXd& x) noexcept;
    Eigen::VectorXd gather(const Eigen::VectorXd& full) const;
    void scatter_add(const Eigen::VectorXd& free, double factor, Eigen::VectorXd& full) const;
    /// (mass_factor M + stiffness_factor S) y = rhs_, directly or by cg_iterations of conjugate gradients.
    bool solve(double mass_factor, double stiffness_factor, int cg_iterations, double cg_tolerance,
               Eigen::VectorXd& y) noexcept;

    using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int32_t>;
    const TetSystem& system_;
    std::vector<NodeIndex> free_node_;
    Eigen::VectorXd free_mass_;   // per free row
    std::vector<double> values_;  // S, then the matrix of the step
    SparseMatrix matrix_;
    Eigen::SimplicialLDLT<SparseMatrix, Eigen::Lower> ldlt_;
    Eigen::VectorXd f_, rhs_;
};

}  // namespace teres
