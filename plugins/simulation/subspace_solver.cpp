#include "plugins/simulation/subspace_solver.h"

#include <algorithm>
#include <cmath>

namespace teres {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDependent = 1e-6;  // columns shorter than this share of the longest after orthogonalisation
constexpr double kArmijo = 1e-4;
constexpr double kEnergyNoise = 1e-12;
constexpr int kMaxBacktracks = 6;
constexpr double kSameInertia = 0.02;  // metrics of inertia that differs by less serve each other: they only steer

MatrixXd orthonormal(const MatrixXd& columns) {
    const Eigen::ColPivHouseholderQR<MatrixXd> qr(columns.colwise().normalized());
    const auto diagonal = qr.matrixR().diagonal().cwiseAbs();
    Index rank = 0;
    while (rank < diagonal.size() && diagonal(rank) > kDependent * diagonal(0)) ++rank;
    return qr.householderQ() * MatrixXd::Identity(columns.rows(), rank);
}

}  // namespace

SubspaceSolver::SubspaceSolver(const MechanicalSystem& system, const EquilibriumSettings& settings,
                               const MatrixXd& columns)
    : system_(system),
      relative_residual_(settings.relative_residual),
      max_iterations_(settings.max_iterations),
      basis_(orthonormal(columns)) {
    const std::size_t stride = padded_lanes(1), dofs = 3 * system.num_nodes();
    for (auto* v : {&x_, &gradient_}) v->assign(dofs * stride, 0.0);
    energy_.assign(stride, 0.0);
    theta_one_.assign(std::max<std::size_t>(1, system.parts().num_parameters), 0.0);
    values_.reserve(system.pattern().num_values());
    full_.setZero(static_cast<Index>(dofs));
    for (auto* v : {&r_, &trial_r_, &dq_, &y_, &Hy_}) v->setZero(basis_.cols());
    H_.setIdentity(basis_.cols(), basis_.cols());
}

void SubspaceSolver::project(double* v) const noexcept {
    Eigen::Map<VectorXd> all(v, basis_.rows());
    all = basis_ * (basis_.transpose() * all).eval();
}

bool SubspaceSolver::start_metric(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                                  const double* x) noexcept {
    const std::size_t stride = padded_lanes(1);
    Positions positions(3, static_cast<Index>(system_.num_nodes()));
    for (std::size_t d = 0; d < 3 * system_.num_nodes(); ++d) positions.data()[d] = x[d * stride];
    for (std::size_t p = 0; p < system_.parts().num_parameters; ++p) theta_one_[p] = theta[p * stride];
    if (!system_.tangent(actions, inertia, 0, theta_one_.data(), positions, values_)) return false;
    const auto& pattern = system_.pattern();
    BlockPattern::Rows free = BlockPattern::Rows::Zero(pattern.num_rows(), basis_.cols());
    for (std::size_t i = 0; i < system_.num_nodes(); ++i)
        if (const auto row = pattern.free_index(static_cast<NodeIndex>(i)); row >= 0)
            free.middleRows<3>(3 * static_cast<Index>(row)) = basis_.middleRows<3>(3 * static_cast<Index>(i));
    const Eigen::LDLT<MatrixXd> reduced(free.transpose() * pattern.multiply(values_, free));
    if (reduced.info() != Eigen::Success || !reduced.isPositive()) return false;
    H_ = reduced.solve(MatrixXd::Identity(basis_.cols(), basis_.cols()));
    coefficient_ = inertia.coefficient;
    return true;
}

double SubspaceSolver::evaluate(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                                const double* x, VectorXd& r) noexcept {
    const std::size_t stride = padded_lanes(1);
    system_.gradient(actions, inertia, theta, x, gradient_.data(), energy_.data(), stride, 1);
    for (Index d = 0; d < full_.size(); ++d) full_(d) = gradient_[static_cast<std::size_t>(d) * stride];
    r.noalias() = basis_.transpose() * full_;
    return energy_[0];
}

EquilibriumReport SubspaceSolver::solve(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                                        double* x) noexcept {
    EquilibriumReport report;
    const std::size_t stride = padded_lanes(1);
    const bool same_inertia = std::abs(coefficient_ - inertia.coefficient) <= kSameInertia * inertia.coefficient;
    if (!same_inertia && !start_metric(actions, inertia, theta, x)) return report;
    double energy = evaluate(actions, inertia, theta, x, r_);
    const double bound = relative_residual_ * actions.force_n.norm();
    for (; r_.norm() > bound && report.iterations < max_iterations_; ++report.iterations) {
        dq_.noalias() = -(H_ * r_);
        const double slope = -r_.dot(dq_);
        if (!(slope > 0.0)) {  // curvature was lost: from the tangent again
            if (!start_metric(actions, inertia, theta, x)) break;
            continue;
        }
        move_.noalias() = basis_ * dq_;
        double step = 1.0, trial_energy = 0.0;
        bool accepted = false;
        for (int backtrack = 0; backtrack < kMaxBacktracks && !accepted; ++backtrack) {
            if (backtrack > 0) step *= 0.5;
            for (std::size_t k = 0; k < x_.size(); ++k) x_[k] = x[k] + step * move_(static_cast<Index>(k / stride));
            trial_energy = evaluate(actions, inertia, theta, x_.data(), trial_r_);
            const double noise = kEnergyNoise * std::abs(energy);
            accepted =
                trial_r_.allFinite() && (trial_energy <= energy - kArmijo * step * slope ||
                                         (trial_energy <= energy + 100.0 * noise && trial_r_.norm() < r_.norm()));
        }
        if (!accepted) break;
        // H <- (I - rho s y^T) H (I - rho y s^T) + rho s s^T
        dq_ *= step;
        y_ = trial_r_ - r_;
        const double sy = dq_.dot(y_);
        if (sy > 0.0) {
            Hy_.noalias() = H_ * y_;
            H_ += (1.0 + y_.dot(Hy_) / sy) / sy * dq_ * dq_.transpose() -
                  (Hy_ * dq_.transpose() + dq_ * Hy_.transpose()) / sy;
        }
        std::copy(x_.begin(), x_.end(), x);
        energy = trial_energy;
        r_.swap(trial_r_);
    }
    report.lanes_converged = r_.norm() <= bound ? 1 : 0;
    report.relative_residual = r_.norm() / std::max(actions.force_n.norm(), 1e-300);
    return report;
}

}  // namespace teres
