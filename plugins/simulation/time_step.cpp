#include "plugins/simulation/time_step.h"

#include <algorithm>
#include <cmath>

namespace teres {

namespace {
constexpr double kSameStep = 0.01;    // steps that differ by less share a factorisation: it only steers the solver
constexpr double kWholeParts = 1e-9;  // of a part: rounding of a step that is a multiple of the longest
constexpr std::size_t kHalvings = 3;
constexpr double kMostParts = 1000;  // after a pause of a live stream: the loop goes on

EquilibriumReport one_after_another(EquilibriumReport a, const EquilibriumReport& b) {
    a.lanes_converged = std::min(a.lanes_converged, b.lanes_converged);
    a.iterations = std::max(a.iterations, b.iterations);
    a.newton_lanes = std::max(a.newton_lanes, b.newton_lanes);
    a.newton_steps += b.newton_steps;
    a.factorisations += b.factorisations;
    a.relative_residual = std::max(a.relative_residual, b.relative_residual);
    return a;
}
}  // namespace

std::size_t state_blocks(TimeScheme scheme) {
    switch (scheme) {
        case TimeScheme::kQuasiStatic:
            return 1;
        case TimeScheme::kImplicitEuler:
            return 2;
        case TimeScheme::kGeneralisedAlpha:
            return 3;
    }
    return 1;
}

int parts_of_step(double length_s, double longest_s) {
    const double parts = std::ceil(length_s / longest_s - kWholeParts);
    return parts > 1.0 ? static_cast<int>(std::min(parts, kMostParts)) : 1;
}

TimeStepper::TimeStepper(const MechanicalSystem& system, EquilibriumSolver& solver, TimeStepSettings settings,
                         std::size_t max_lanes)
    : system_(system), solver_(solver), settings_(settings) {
    const std::size_t stride = padded_lanes(max_lanes), dofs = 3 * system.num_nodes();
    for (auto* v : {&target_, &y_, &velocity_target_}) v->assign(dofs * stride, 0.0);
    if (settings_.scheme != TimeScheme::kQuasiStatic) starts_.resize(kHalvings);
    for (Start& start : starts_) start.state.assign(state_blocks(settings_.scheme) * dofs * stride, 0.0);
    theta_one_.assign(std::max<std::size_t>(1, system.parts().num_parameters), 0.0);
    positions_.resize(3, static_cast<Eigen::Index>(system.num_nodes()));
    if (settings_.rayleigh_stiffness_s > 0.0) {
        damping_.values.assign(max_lanes, std::vector<double>(system.pattern().num_values(), 0.0));
        damping_.difference.assign(static_cast<std::size_t>(system.pattern().num_rows()), 0.0);
        damping_.product.assign(static_cast<std::size_t>(system.pattern().num_rows()), 0.0);
    }
}

double TimeStepper::alpha_f() const {
    return settings_.scheme == TimeScheme::kGeneralisedAlpha
               ? settings_.spectral_radius / (settings_.spectral_radius + 1.0)
               : 0.0;
}

EquilibriumReport TimeStepper::step(const ExternalActions& actions, double h, const double* theta, double* state,
                                    std::size_t lanes) noexcept {
    if (settings_.scheme == TimeScheme::kQuasiStatic) return solver_.solve(actions, {}, theta, state, lanes);
    const int parts = parts_of_step(h, settings_.max_step_s);
    // What did not hold even so will hardly hold now: it costs no halves again.
    const auto one_part = [&](const ExternalActions& at_end) {
        const EquilibriumReport report =
            step_or_halve(at_end, h / parts, theta, state, lanes, holds_ ? starts_ : std::span<Start>());
        holds_ = report.lanes_converged == static_cast<int>(lanes);
        return report;
    };
    if (parts == 1) return one_part(actions);
    at_part_ = actions;
    first_force_n_ = last_force_n_.size() == actions.force_n.size() ? last_force_n_ : actions.force_n;
    EquilibriumReport report;
    report.lanes_converged = static_cast<int>(lanes);
    for (int k = 1; k <= parts; ++k) {
        at_part_.force_n = first_force_n_ + static_cast<double>(k) / parts * (actions.force_n - first_force_n_);
        report = one_after_another(report, one_part(at_part_));
    }
    return report;
}

EquilibriumReport TimeStepper::step_or_halve(const ExternalActions& actions, double h, const double* theta,
                                             double* state, std::size_t lanes, std::span<Start> starts) noexcept {
    if (starts.empty()) return step_at_once(actions, h, theta, state, lanes);
    const std::size_t size = state_blocks(settings_.scheme) * 3 * system_.num_nodes() * padded_lanes(lanes);
    Start& start = starts.front();
    std::copy_n(state, size, start.state.begin());
    start.last_force_n = last_force_n_;
    const EquilibriumReport whole = step_at_once(actions, h, theta, state, lanes);
    if (whole.lanes_converged == static_cast<int>(lanes)) return whole;
    std::copy_n(start.state.begin(), size, state);
    last_force_n_ = start.last_force_n;
    start.middle = actions;
    if (last_force_n_.size() == actions.force_n.size()) start.middle.force_n = 0.5 * (last_force_n_ + actions.force_n);
    const std::span<Start> further = starts.subspan(1), none;
    const EquilibriumReport first = step_or_halve(start.middle, 0.5 * h, theta, state, lanes, further);
    const bool held = first.lanes_converged == static_cast<int>(lanes);
    const EquilibriumReport second = step_or_halve(actions, 0.5 * h, theta, state, lanes, held ? further : none);
    return one_after_another(first, second);
}

EquilibriumReport TimeStepper::step_at_once(const ExternalActions& actions, double h, const double* theta,
                                            double* state, std::size_t lanes) noexcept {
    const std::size_t stride = padded_lanes(lanes), size = 3 * system_.num_nodes() * stride;
    double* x = state;
    double* v = state + size;
    double* a = state + 2 * size;  // generalised alpha only
    if (subspace_ == nullptr && std::abs(h - last_dt_s_) > kSameStep * last_dt_s_) {
        solver_.follow_system();
        last_dt_s_ = h;
    }

    // Acceleration and velocity of the scheme are affine in the unknown y:  a = a1 y + a0,  v = v1 y + v0.
    const bool euler = settings_.scheme == TimeScheme::kImplicitEuler;
    const double rho = settings_.spectral_radius;
    const double alpha_m = euler ? 0.0 : (2.0 * rho - 1.0) / (rho + 1.0);
    const double alpha_f = this->alpha_f();
    const double gamma = 0.5 - alpha_m + alpha_f;
    const double beta = 0.25 * (1.0 - alpha_m + alpha_f) * (1.0 - alpha_m + alpha_f);
    const double a1 = euler ? 1.0 / (h * h) : (1.0 - alpha_m) / (beta * h * h * (1.0 - alpha_f));
    const double v1 = euler ? 1.0 / h : gamma / (beta * h);
    const double rM = settings_.rayleigh_mass_1_s, rK = settings_.rayleigh_stiffness_s;
    const double c = a1 + rM * v1;
    for (std::size_t k = 0; k < size; ++k) {
        double a0, v0;
        if (euler) {
            v0 = -x[k] / h;                   // v' = (y - x)/h
            a0 = -x[k] / (h * h) - v[k] / h;  // a' = (v' - v)/h
        } else {
            const double new_x = -alpha_f * x[k] / (1.0 - alpha_f);  // x' at y = 0
            const double new_a = (new_x - x[k] - h * v[k]) / (beta * h * h) - (0.5 / beta - 1.0) * a[k];
            const double new_v = v[k] + h * ((1.0 - gamma) * a[k] + gamma * new_a);
            a0 = (1.0 - alpha_m) * new_a + alpha_m * a[k];
            v0 = (1.0 - alpha_f) * new_v + alpha_f * v[k];
        }
        target_[k] = -(a0 + rM * v0) / c;
        velocity_target_[k] = -v0 / v1;
        y_[k] = x[k] + (1.0 - alpha_f) * h * v[k];  // start value
    }
    for (std::size_t i = 0; i < system_.num_nodes(); ++i)
        if (system_.parts().held[i])
            std::copy_n(x + 3 * i * stride, 3 * stride, y_.begin() + static_cast<std::ptrdiff_t>(3 * i * stride));

    Inertia inertia{c, target_.data(), nullptr, 0};
    if (rK > 0.0) {
        damping_.coefficient = rK * v1;
        damping_.target = velocity_target_.data();
        for (std::size_t l = 0; l < lanes; ++l) {
            for (std::size_t d = 0; d < 3 * system_.num_nodes(); ++d) positions_.data()[d] = x[d * stride + l];
            for (std::size_t p = 0; p < system_.parts().num_parameters; ++p) theta_one_[p] = theta[p * stride + l];
            system_.tangent(actions, {}, 0, theta_one_.data(), positions_, damping_.values[l]);
        }
        inertia.damping = &damping_;
    }
    at_alpha_ = actions;
    if (last_force_n_.size() == actions.force_n.size())
        at_alpha_.force_n = (1.0 - alpha_f) * actions.force_n + alpha_f * last_force_n_;
    last_force_n_ = actions.force_n;

    const EquilibriumReport report = subspace_ != nullptr && lanes == 1
                                         ? subspace_->solve(at_alpha_, inertia, theta, y_.data())
                                         : solver_.solve(at_alpha_, inertia, theta, y_.data(), lanes);
    for (std::size_t k = 0; k < size; ++k) {
        if (euler) {
            v[k] = (y_[k] - x[k]) / h;
            x[k] = y_[k];
        } else {
            const double new_x = (y_[k] - alpha_f * x[k]) / (1.0 - alpha_f);
            const double new_a = (new_x - x[k] - h * v[k]) / (beta * h * h) - (0.5 / beta - 1.0) * a[k];
            v[k] += h * ((1.0 - gamma) * a[k] + gamma * new_a);
            x[k] = new_x;
            a[k] = new_a;
        }
    }
    return report;
}

}  // namespace teres
