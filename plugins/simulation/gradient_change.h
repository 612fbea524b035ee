// How the gradient of the energy at a base trajectory changes when its hypothesis gives way to another one:
//
//     dg_f = g(x_f; other) - g(x_f; base),   x_f: the base, not solved again
//
// what first-order responses (trajectory.h) and the forces of an effect are made of.
#pragma once

#include <functional>
#include <vector>

#include "plugins/simulation/base_trajectory.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

class GradientChange {
  public:
    /// A scene's coefficients at a frame: all that its gradient depends on besides the body's state.
    struct Coefficients {
        bool body_touched = false, ties_touched = false;
        std::vector<std::vector<double>> scale, prestress;
        std::vector<double> stiffening;
        Eigen::VectorXd g_ties, g_rest;  // gradient of tethers, of all but body and tethers (3N)
        double rayleigh_mass_1_s = 0.0, rayleigh_stiffness_s = 0.0;
    };
    using Visitor =
        std::function<void(std::size_t frame, std::size_t other, const Coefficients& base, const Eigen::VectorXd& dg)>;

    /// All must outlive it. The player's scene is that of the last frame entered.
    GradientChange(ScenePlayer& player, const std::vector<std::unique_ptr<Effect>>& effects, BaseTrajectory& base)
        : player_(player), effects_(effects), base_(base) {}

    /// Frame by frame of those played, every other hypothesis.
    void visit(const std::vector<HypothesisPoint>& others, const Visitor& seen) const;
    /// The scene of a hypothesis at a frame of the base trajectory, with the memory it has there.
    void enter_frame(const Hypothesis& h, std::size_t frame, const ViscousMemory& memory,
                     ExternalActions& actions) const;
    /// The memory of such a scene after that frame.
    void leave_frame(std::size_t frame, const std::vector<ViscousBranch>& viscosity, ViscousMemory& memory) const;

  private:
    void gradient_of_rest(const ExternalActions& actions, std::size_t frame, Eigen::VectorXd& g) const;
    void change_of_gradient(const Hypothesis& h, const ExternalActions& actions, std::size_t frame,
                            const Coefficients& base, Eigen::VectorXd& dg) const;

    ScenePlayer& player_;
    const std::vector<std::unique_ptr<Effect>>& effects_;
    BaseTrajectory& base_;
};

}  // namespace teres
