// The whole mechanical system at one time: body, tethers, gravity, loads and tools; total potential of every
// lane.
//
//   Pi(x; theta, t) = Psi_body(x) + sum tethers psi(x; theta) + sum tools k/2 |x - x_tool|^2 - f(t).x - m g.x
//   [J]
//
// Equilibrium is dPi/dx = 0 on the free nodes. With Inertia the same function is the incremental potential of
// one implicit time step, Pi + c/2 |x - x_hat|^2_M.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "plugins/simulation/block_pattern.h"
#include "plugins/simulation/body.h"
#include "plugins/simulation/potential_term.h"
#include "plugins/simulation/task_team.h"
#include "plugins/simulation/tether.h"

namespace teres {

struct ToolSpring {
    NodeIndex node = 0;
    double stiffness_n_per_m = 0.0;
};

struct LoadPatch {
    std::vector<NodeIndex> node;
    std::vector<double> weight;
};

/// Known inputs of a step, resolved to nodes.
struct ExternalActions {
    Eigen::VectorXd force_n;           ///< 3N, dead loads incl. gravity
    Eigen::Matrix3Xd tool_position_m;  ///< per tool; NaN: detached
};

/// Stiffness-proportional damping of an implicit step: adds coefficient * K_l (x - target) with a fixed K_l
/// per lane.
struct StiffnessDamping {
    double coefficient = 0.0;                 ///< rK / step [-]; 0: none
    const double* target = nullptr;           ///< batch layout
    std::vector<std::vector<double>> values;  ///< K_l over the pattern, per lane
    std::vector<double> difference, product;  ///< workspaces over free rows
};

/// Inertia of an implicit step: adds coefficient * mass * (x - target) to the gradient.
struct Inertia {
    double coefficient = 0.0;             ///< c [1/s^2]; 0: quasi-static
    const double* target = nullptr;       ///< x_hat, batch layout
    StiffnessDamping* damping = nullptr;  ///< null: none
    std::size_t damping_lane = 0;         ///< first lane of x in `damping` (a lane solved alone)
};

class MechanicalSystem {
  public:
    struct Parts {
        Positions X;  ///< rest positions of all nodes (mid-edge nodes included)
        Body body;
        std::vector<Tether> tethers;
        std::vector<LoadPatch> loads;
        std::vector<ToolSpring> tools;
        std::vector<char> held;        ///< 1 for clamped nodes
        Eigen::VectorXd node_mass_kg;  ///< lumped
        Eigen::Vector3d gravity_m_s2 = Eigen::Vector3d::Zero();
        std::size_t num_parameters = 0;
        const PotentialTerm* term = nullptr;  ///< of effects; not owned
        int threads = 1;                      ///< that share a step
    };
    explicit MechanicalSystem(Parts parts);
    MechanicalSystem(const MechanicalSystem&) = delete;
    MechanicalSystem& operator=(const MechanicalSystem&) = delete;

    const Parts& parts() const { return parts_; }
    Parts& parts() { return parts_; }
    const BlockPattern& pattern() const { return pattern_; }
    std::size_t num_nodes() const { return static_cast<std::size_t>(parts_.X.cols()); }
    TaskTeam& team() const { return work_->team; }

    /// [loop] Resolves region forces (3 per load patch) and tool positions (3 per tool).
    void resolve(std::span<const double> region_force_n, std::span<const double> tool_position_m,
                 ExternalActions& out) const;
    /// [loop] Overwrites energy (per lane) and gradient (batch layout; zero on held nodes) of the first `lanes` lanes;
    /// others hold anything afterwards.
    void gradient(const ExternalActions& actions, const Inertia& inertia, const double* theta, const double* x,
                  double* gradient, double* energy, std::size_t stride, std::size_t lanes) const noexcept;
    /// [loop] Overwrites the tangent of one state. False outside the law's domain.
    bool tangent(const ExternalActions& actions, const Inertia& inertia, std::size_t lane, const double* theta,
                 const Positions& x, std::vector<double>& values) const noexcept;

  private:
    void add_damping(const Inertia& inertia, const double* x, double* gradient, double* energy, std::size_t stride,
                     std::size_t lanes) const noexcept;

    /// Workspaces of gradient(): one call at a time.
    struct Work {
        explicit Work(int threads) : team(threads) {}
        TaskTeam team;
        PointShares shares;
        std::vector<double> spare, energy;  ///< of each thread; grow with the widest batch
    };

    Parts parts_;
    BlockPattern pattern_;
    std::unique_ptr<Work> work_;
};

}  // namespace teres
