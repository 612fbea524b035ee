#include "plugins/simulation/implicit_step.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "plugins/simulation/static_stvk.h"

namespace teres {

using Eigen::Index;
using Eigen::VectorXd;

Result<TetSystem> TetSystem::make(std::unique_ptr<ElasticTets> body, const VectorXd& node_mass,
                                  const std::vector<char>& held) {
    const auto nodes = static_cast<std::size_t>(node_mass.size());
    if (held.size() != nodes)
        return invalid_input("held flags for " + std::to_string(held.size()) + " of " + std::to_string(nodes) +
                             " nodes");
    for (std::size_t a = 0; a < nodes; ++a)
        if (!held[a] && !(node_mass(Index(a)) > 0.0))
            return invalid_input("node " + std::to_string(a) + " moves and has no mass: " +
                                 std::to_string(node_mass(Index(a))) + " kg (not in any tetrahedron?)");
    TetSystem system;
    std::vector<std::set<NodeIndex>> neighbours(nodes);
    body->couple(neighbours);
    system.pattern = BlockPattern::make(neighbours, held);
    body->bind(system.pattern);
    system.body = std::move(body);
    system.node_mass = node_mass;
    system.held = held;
    return system;
}

Stepper::Stepper(const TetSystem& system) : system_(system) {
    const BlockPattern& pattern = system.pattern;
    for (std::size_t a = 0; a < system.held.size(); ++a)
        if (!system.held[a]) free_node_.push_back(static_cast<NodeIndex>(a));
    free_mass_.resize(pattern.num_rows());
    for (std::size_t a = 0; a < free_node_.size(); ++a)
        free_mass_.segment<3>(3 * Index(a)).setConstant(system.node_mass(free_node_[a]));
    values_.assign(pattern.num_values(), 0.0);
    matrix_ = Eigen::Map<const SparseMatrix>(pattern.num_rows(), pattern.num_rows(), Index(pattern.num_values()),
                                             pattern.column_start().data(), pattern.row().data(), values_.data());
    ldlt_.analyzePattern(matrix_);
}

void Stepper::forces(const StepDrive& drive, const VectorXd& x, VectorXd& f) const noexcept {
    if (drive.outer_force != nullptr)
        f = *drive.outer_force;
    else
        f.setZero(system_.num_dofs());
    for (Index a = 0; a < system_.node_mass.size(); ++a) f.segment<3>(3 * a) += system_.node_mass(a) * system_.gravity;
    system_.body->add_force(x, drive.modulus, f);
    for (const AnchorSpring& spring : drive.springs)
        f.segment<3>(3 * Index(spring.node)) += spring.force(x.segment<3>(3 * Index(spring.node)));
}

void Stepper::forces_and_stiffness(const StepDrive& drive, const VectorXd& x) noexcept {
    if (drive.outer_force != nullptr)
        f_ = *drive.outer_force;
    else
        f_.setZero(system_.num_dofs());
    for (Index a = 0; a < system_.node_mass.size(); ++a) f_.segment<3>(3 * a) += system_.node_mass(a) * system_.gravity;
    std::fill(values_.begin(), values_.end(), 0.0);
    system_.body->add_force_and_stiffness(x, drive.modulus, system_.pattern, f_, values_);
    for (const AnchorSpring& spring : drive.springs) {
        const Eigen::Vector3d at = x.segment<3>(3 * Index(spring.node));
        f_.segment<3>(3 * Index(spring.node)) += spring.force(at);
        if (system_.held[static_cast<std::size_t>(spring.node)]) continue;
        system_.pattern.add(spring.node, spring.node, system_.pattern.block(spring.node, spring.node),
                            spring.stiffness(at), values_);
    }
}

VectorXd Stepper::gather(const VectorXd& full) const {
    VectorXd free(free_mass_.size());
    for (std::size_t a = 0; a < free_node_.size(); ++a)
        free.segment<3>(3 * Index(a)) = full.segment<3>(3 * Index(free_node_[a]));
    return free;
}

void Stepper::scatter_add(const VectorXd& free, double factor, VectorXd& full) const {
    for (std::size_t a = 0; a < free_node_.size(); ++a)
        full.segment<3>(3 * Index(free_node_[a])) += factor * free.segment<3>(3 * Index(a));
}

bool Stepper::solve(double mass_factor, double stiffness_factor, int cg_iterations, double cg_tolerance,
                    VectorXd& y) noexcept {
    for (double& value : values_) value *= stiffness_factor;
    for (Index j = 0; j < free_mass_.size(); ++j)  // the diagonal is first in its column
        values_[static_cast<std::size_t>(system_.pattern.column_start()[static_cast<std::size_t>(j)])] +=
            mass_factor * free_mass_(j);
    if (cg_iterations > 0) {
        conjugate_gradient(system_.pattern, values_, rhs_, cg_iterations, cg_tolerance, y);
        return y.allFinite();
    }
    std::copy(values_.begin(), values_.end(), matrix_.valuePtr());
    ldlt_.factorize(matrix_);
    if (ldlt_.info() != Eigen::Success) return false;
    y = ldlt_.solve(rhs_);
    return y.allFinite();
}

bool Stepper::implicit_euler(const StepDrive& drive, double h, double velocity_damping, MotionState& state) noexcept {
    const double rM = system_.rayleigh_mass, rK = system_.rayleigh_stiffness;
    forces_and_stiffness(drive, state.x);
    const VectorXd v = gather(state.v);
    VectorXd Sv = VectorXd::Zero(v.size());
    system_.pattern.multiply(values_, v.data(), Sv.data());
    rhs_ = h * (gather(f_) - rM * free_mass_.cwiseProduct(v) - (h + rK) * Sv);
    VectorXd dv;
    if (!solve(1.0 + h * rM, h * (h + rK), system_.cg_iterations, system_.cg_tolerance, dv)) return false;
    scatter_add(dv, 1.0, state.v);
    scatter_add(v + dv, h, state.x);
    if (velocity_damping != 0.0) state.v *= std::exp(-h * velocity_damping);
    return true;
}

bool Stepper::implicit_midpoint(const StepDrive& drive, double h, double velocity_damping,
                                MotionState& state) noexcept {
    const double rM = system_.rayleigh_mass, rK = system_.rayleigh_stiffness;
    if (state.p.size() == 0) {
        state.p = state.v;
        for (Index a = 0; a < system_.node_mass.size(); ++a) state.p.segment<3>(3 * a) *= system_.node_mass(a);
    }
    forces_and_stiffness(drive, state.x);
    rhs_ = gather(f_) + 2.0 / h * gather(state.p);
    VectorXd d;
    if (!solve(4.0 / (h * h) + 4.0 * rM / h, 1.0 + 4.0 * rK / h, system_.cg_iterations, system_.cg_tolerance, d))
        return false;
    VectorXd middle = state.x;
    scatter_add(d, 1.0, middle);
    forces(drive, middle, f_);
    state.v.setZero();
    scatter_add(d, 2.0 / h, state.v);
    scatter_add(d, 2.0, state.x);
    state.p.setZero();
    scatter_add(2.0 / h * free_mass_.cwiseProduct(d) + 0.5 * h * gather(f_), 1.0, state.p);
    if (velocity_damping != 0.0) {
        state.v *= std::exp(-h * velocity_damping);
        state.p *= std::exp(-h * velocity_damping);
    }
    return true;
}

bool Stepper::static_equilibrium(const StepDrive& drive, const StaticOptions& options, MotionState& state) noexcept {
    for (int k = 0; k < options.newton_iterations; ++k) {
        forces_and_stiffness(drive, state.x);
        rhs_ = gather(f_);
        if (rhs_.norm() <= options.residual_tolerance_n) break;
        VectorXd d;
        if (!solve(0.0, 1.0, options.cg_iterations, options.cg_tolerance, d)) return false;
        scatter_add(d, 1.0, state.x);
        if (d.norm() <= options.correction_tolerance_m) break;
    }
    return true;
}

}  // namespace teres
