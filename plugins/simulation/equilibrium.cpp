#include "plugins/simulation/equilibrium.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "core/check.h"
#include "plugins/simulation/lane_history.h"
#include "plugins/simulation/shared_metric.h"

namespace teres {

namespace {
constexpr double kArmijo = 1e-4;  // sufficient decrease
constexpr int kMaxBacktracks = 14;
constexpr double kEnergyNoise = 1e-12;  // relative rounding of the potential

// Adds the time of `work` to `total`.
template <class Work>
auto timed(double& total, const Work& work) {
    struct Stopwatch {
        double& total;
        std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
        ~Stopwatch() { total += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); }
    } stopwatch{total};
    return work();
}
}  // namespace

namespace {

// Degree of freedom of each row of the metric.
std::vector<std::int32_t> dofs_of_rows(const MechanicalSystem& system, const MetricSolver& metric) {
    std::vector<std::int32_t> of_free(static_cast<std::size_t>(system.pattern().num_rows())), dof;
    for (std::size_t i = 0; i < system.num_nodes(); ++i)
        if (const auto free = system.pattern().free_index(static_cast<NodeIndex>(i)); free >= 0)
            for (std::size_t a = 0; a < 3; ++a)
                of_free[3 * static_cast<std::size_t>(free) + a] = static_cast<std::int32_t>(3 * i + a);
    for (std::size_t r = 0; r < metric.num_rows(); ++r)
        dof.push_back(of_free[static_cast<std::size_t>(metric.free_row(r))]);
    return dof;
}

}  // namespace

struct EquilibriumSolver::Workspace {
    std::unique_ptr<SharedMetric> metric;
    std::unique_ptr<MetricRenewal> renewal;  // null: none in the background
    int renewal_age = 0;                     // calls since it was begun
    LaneHistory history;
    std::vector<double> values;
    std::vector<double> gradient, trial, trial_gradient;
    std::vector<double> energy, trial_energy, slope, norm, trial_norm, step;  // per lane
    std::vector<char> active, accepted;
    std::size_t open_lanes = 0;  // lanes from here on have converged
    bool stale = false;          // the last call needed many iterations: factorise anew at the start of the next
    // one lane alone, for plain Newton
    std::unique_ptr<Cholesky> own;  // made on first use
    Eigen::MatrixXd rhs;
    Eigen::VectorXd residual;
    std::vector<double> lane_theta, lane_theta_pack, lane_x, lane_target, lane_damping_target, lane_gradient,
        lane_energy, lane_trial;
    Positions positions;
    std::size_t max_lanes;
    double force_floor = 0.0;

    Workspace(const MechanicalSystem& system, const EquilibriumSettings& settings, std::size_t lanes)
        : metric(std::make_unique<SharedMetric>(system, lanes)),
          renewal(settings.renewal_steps > 0 && !settings.plain_newton ? std::make_unique<MetricRenewal>(system, lanes)
                                                                       : nullptr),
          history(dofs_of_rows(system, metric->solver()), metric->solver().num_storage_rows(), lanes, system.team()),
          max_lanes(lanes) {
        const std::size_t stride = padded_lanes(max_lanes), dofs = 3 * system.num_nodes();
        const std::size_t parameters = std::max<std::size_t>(1, system.parts().num_parameters);
        for (auto* v : {&gradient, &trial, &trial_gradient}) v->assign(dofs * stride, 0.0);
        for (auto* v : {&energy, &trial_energy, &slope, &norm, &trial_norm, &step}) v->assign(stride, 0.0);
        active.assign(stride, 0);
        accepted.assign(stride, 0);
        values.reserve(system.pattern().num_values());
        rhs.resize(system.pattern().num_rows(), 1);
        residual.resize(system.pattern().num_rows());
        lane_theta.assign(parameters, 0.0);
        lane_theta_pack.assign(parameters * kPackLanes, 0.0);
        for (auto* v : {&lane_x, &lane_target, &lane_damping_target, &lane_gradient, &lane_trial})
            v->assign(dofs * kPackLanes, 0.0);
        lane_energy.assign(kPackLanes, 0.0);
        positions.resize(3, static_cast<Eigen::Index>(system.num_nodes()));
        double volume = 0.0;
        for (const double v : system.parts().body.points().front().volume) volume += v;
        force_floor = 1e-5 * system.parts().body.material().mu() * std::cbrt(volume * volume);
    }
};

EquilibriumSolver::EquilibriumSolver(const MechanicalSystem& system, EquilibriumSettings settings,
                                     std::size_t max_lanes)
    : system_(system), settings_(settings), w_(std::make_unique<Workspace>(system, settings, max_lanes)) {}

EquilibriumSolver::~EquilibriumSolver() = default;

void EquilibriumSolver::release_system() noexcept {
    if (w_->renewal) w_->renewal->release_system();
}

void EquilibriumSolver::follow_system() noexcept {
    w_->history.start(0, 0);
    w_->stale = true;
}

// The lanes' common state, where the shared metric is made: mean position, geometric mean of the parameters.
void EquilibriumSolver::mean_state(const Batch& batch) noexcept {
    auto& w = *w_;
    const auto lanes = static_cast<double>(batch.lanes);
    for (std::size_t d = 0; d < 3 * system_.num_nodes(); ++d) {
        double sum = 0.0;
        for (std::size_t l = 0; l < batch.lanes; ++l) sum += batch.x[d * batch.stride + l];
        w.positions.data()[d] = sum / lanes;
    }
    for (std::size_t p = 0; p < system_.parts().num_parameters; ++p) {
        double sum = 0.0, log_sum = 0.0;
        for (std::size_t l = 0; l < batch.lanes; ++l) {
            const double value = batch.theta[p * batch.stride + l];
            sum += value;
            log_sum += std::log(value);
        }
        w.lane_theta[p] = std::isfinite(log_sum) ? std::exp(log_sum / lanes) : sum / lanes;
    }
}

bool EquilibriumSolver::factorise(const ExternalActions& actions, const Batch& batch,
                                  EquilibriumReport& report) noexcept {
    auto& w = *w_;
    const auto& [theta, x, inertia, lanes, stride] = batch;
    return timed(times_.factorise, [&] {
        mean_state(batch);
        if (!w.metric->read(actions, inertia, 0, w.lane_theta.data(), w.positions) ||
            !w.metric->factorise(system_.team(), report.factorisations))
            return false;
        w.history.start(stride, MetricSolver::lane_stride(lanes));
        w.metric->set_lanes(theta, x, stride, lanes);
        return true;
    });
}

// A body with inertia has moved on until a renewal is taken over: its metric is made anew at once.
bool EquilibriumSolver::renews_in_background(const Inertia& inertia) const noexcept {
    return w_->renewal != nullptr && inertia.coefficient == 0.0;
}

// Takes over a renewal that is old enough; begins one when iterations grow.
void EquilibriumSolver::follow_renewal(const ExternalActions& actions, const Batch& batch,
                                       EquilibriumReport& report) noexcept {
    auto& w = *w_;
    if (!renews_in_background(batch.inertia)) return;
    if (w.renewal->running() && ++w.renewal_age >= settings_.renewal_steps) {
        if (w.renewal->take(w.metric, report.factorisations)) w.history.start(0, 0);
    } else if (!w.renewal->running() && report.iterations > settings_.renew_after) {
        mean_state(batch);
        w.renewal->begin(actions, w.lane_theta.data(), w.positions);
        w.renewal_age = 0;
    }
}

double EquilibriumSolver::force_scale(const ExternalActions& actions) const noexcept {
    // The loads, or a small share of mu V^(2/3) when nothing pulls.
    return std::max(actions.force_n.norm(), w_->force_floor);
}

EquilibriumReport EquilibriumSolver::solve(const ExternalActions& actions, const Inertia& inertia, const double* theta,
                                           double* x, std::size_t lanes) noexcept {
    auto& w = *w_;
    EquilibriumReport report;
    const std::size_t stride = padded_lanes(lanes);
    TERES_CHECK(lanes > 0 && lanes <= w.max_lanes);
    if (!settings_.plain_newton) {
        const Batch batch{theta, x, inertia, lanes, stride};
        iterate(actions, batch, report);
        follow_renewal(actions, batch, report);
    } else {
        std::fill_n(w.active.begin(), lanes, 1);
    }
    for (std::size_t l = 0; l < lanes; ++l) {
        if (w.active[l]) {
            ++report.newton_lanes;
            report.lanes_converged +=
                timed(times_.newton, [&] { return newton(actions, inertia, theta, x, l, stride, report); });
        } else {
            ++report.lanes_converged;
        }
    }
    return report;
}

void EquilibriumSolver::iterate(const ExternalActions& actions, const Batch& batch,
                                EquilibriumReport& report) noexcept {
    auto& w = *w_;
    const auto& [theta, x, inertia, lanes, stride] = batch;
    const std::size_t dofs = 3 * system_.num_nodes(), all = dofs * stride;
    for (std::size_t d = 0; d < dofs; ++d)  // padding lanes follow lane 0 so that they stay harmless
        for (std::size_t l = lanes; l < stride; ++l) x[d * stride + l] = x[d * stride];

    // Held rows never move: trial positions and gradients of all rows start from x.
    std::copy_n(x, all, w.trial.data());
    w.history.resume(stride, MetricSolver::lane_stride(lanes));
    timed(times_.gradient,
          [&] { system_.gradient(actions, inertia, theta, x, w.gradient.data(), w.energy.data(), stride, lanes); });
    w.history.norms(w.gradient.data(), w.norm.data());
    const double scale = force_scale(actions);
    const auto converged = [&](std::size_t l) { return w.norm[l] <= settings_.relative_residual * scale; };
    const int before = report.factorisations;
    std::size_t running = 0;
    for (std::size_t l = 0; l < stride; ++l) {
        w.active[l] = l < lanes && (settings_.min_iterations > 0 || !converged(l));
        running += static_cast<std::size_t>(w.active[l]);
    }
    if (running > 0 && w.metric->usable() && !w.stale)
        timed(times_.correction, [&] { w.metric->set_lanes(theta, x, stride, lanes); });
    if (running > 0 && (!w.metric->usable() || w.stale) && !factorise(actions, batch, report)) return;

    bool refactorised = report.factorisations > before;
    w.open_lanes = lanes;
    int iteration = 0;
    for (; running > 0 && iteration < settings_.max_iterations; ++iteration) {
        if (iteration == 2 * settings_.refactorise_after && !refactorised) {
            refactorised = factorise(actions, batch, report);  // the metric is stale
            if (!refactorised) break;
        }
        timed(times_.history, [&] { w.history.begin(w.gradient.data()); });
        while (!w.active[w.open_lanes - 1]) --w.open_lanes;  // what comes after the last open lane rests
        timed(times_.metric, [&] { w.metric->solve(w.history.direction(), lanes, w.open_lanes); });
        timed(times_.correction, [&] { w.metric->correct(w.history.direction(), lanes, w.open_lanes); });
        for (std::size_t l = 0; l < stride; ++l) w.step[l] = w.active[l] ? 1.0 : 0.0;
        timed(times_.history,
              [&] { w.history.finish(w.gradient.data(), x, w.step.data(), w.trial.data(), w.slope.data()); });
        line_search(actions, batch);
        timed(times_.history, [&] {
            w.history.accept(w.trial.data(), w.trial_gradient.data(), w.step.data(), w.accepted.data(), x,
                             w.gradient.data());
        });
        running = 0;
        for (std::size_t l = 0; l < lanes; ++l) {
            if (w.accepted[l]) {
                w.norm[l] = w.trial_norm[l];
                w.energy[l] = w.trial_energy[l];
            } else if (w.active[l]) {
                w.history.forget(l);
            }
            w.active[l] = w.active[l] && (iteration + 1 < settings_.min_iterations || !converged(l));
            running += static_cast<std::size_t>(w.active[l]);
        }
    }
    report.iterations += iteration;
    w.stale = !renews_in_background(inertia) && iteration > settings_.refactorise_after;
    for (std::size_t l = 0; l < lanes; ++l)
        if (!w.active[l]) report.relative_residual = std::max(report.relative_residual, w.norm[l] / scale);
}

// Sufficient decrease, each lane with its own step (Nocedal & Wright, algorithm 3.1). Leaves accepted[l] = 1
// where the trial is to be taken.
void EquilibriumSolver::line_search(const ExternalActions& actions, const Batch& batch) noexcept {
    auto& w = *w_;
    const auto& [theta, x, inertia, lanes, stride] = batch;
    std::size_t open = 0;
    bool shorten = false;
    for (std::size_t l = 0; l < stride; ++l) {
        w.accepted[l] = 0;
        if (w.active[l] && !(w.slope[l] > 0.0)) {  // not a descent direction
            w.step[l] = 0.0;
            shorten = true;
        }
        open += w.step[l] > 0.0;
    }
    for (int backtrack = 0; open > 0; ++backtrack) {
        if (shorten) w.history.retry(x, w.step.data(), w.trial.data());
        timed(times_.gradient, [&] {
            system_.gradient(actions, inertia, theta, w.trial.data(), w.trial_gradient.data(), w.trial_energy.data(),
                             stride, w.open_lanes);
        });
        w.history.norms(w.trial_gradient.data(), w.trial_norm.data());
        shorten = true;
        for (std::size_t l = 0; l < lanes; ++l) {
            if (w.accepted[l] || w.step[l] == 0.0) continue;
            const double noise = kEnergyNoise * (std::abs(w.energy[l]) + w.step[l] * w.slope[l]);
            const bool decrease = w.trial_energy[l] <= w.energy[l] - kArmijo * w.step[l] * w.slope[l];
            const bool at_noise = w.trial_energy[l] <= w.energy[l] + 100.0 * noise && w.trial_norm[l] < w.norm[l];
            if (std::isfinite(w.trial_norm[l]) && (decrease || at_noise))
                w.accepted[l] = 1;
            else
                w.step[l] = backtrack == kMaxBacktracks ? 0.0 : w.step[l] * (backtrack < 2 ? 0.5 : 0.25);
        }
        open = 0;
        for (std::size_t l = 0; l < lanes; ++l) open += w.step[l] > 0.0 && !w.accepted[l];
    }
}

bool EquilibriumSolver::newton(const ExternalActions& actions, const Inertia& inertia, const double* theta, double* x,
                               std::size_t lane, std::size_t stride, EquilibriumReport& report) noexcept {
    auto& w = *w_;
    const std::size_t dofs = 3 * system_.num_nodes();
    const std::size_t num_parameters = system_.parts().num_parameters;
    if (!w.own) w.own = std::make_unique<Cholesky>(system_.pattern());
    std::vector<double>& alone = w.lane_x;
    Inertia lane_inertia = inertia;
    for (std::size_t d = 0; d < dofs; ++d)
        for (std::size_t l = 0; l < kPackLanes; ++l) {
            alone[d * kPackLanes + l] = x[d * stride + lane];
            if (inertia.target != nullptr) w.lane_target[d * kPackLanes + l] = inertia.target[d * stride + lane];
        }
    if (inertia.target != nullptr) lane_inertia.target = w.lane_target.data();
    StiffnessDamping* damping = inertia.damping;
    const double* batch_damping_target = damping != nullptr ? damping->target : nullptr;
    if (damping != nullptr && damping->coefficient != 0.0) {
        for (std::size_t d = 0; d < dofs; ++d)
            for (std::size_t l = 0; l < kPackLanes; ++l)
                w.lane_damping_target[d * kPackLanes + l] = batch_damping_target[d * stride + lane];
        damping->target = w.lane_damping_target.data();
        lane_inertia.damping_lane = lane;
    }
    std::vector<double>& theta_pack = w.lane_theta_pack;
    std::vector<double>& theta_one = w.lane_theta;
    for (std::size_t p = 0; p < num_parameters; ++p) {
        theta_one[p] = theta[p * stride + lane];
        for (std::size_t l = 0; l < kPackLanes; ++l) theta_pack[p * kPackLanes + l] = theta_one[p];
    }
    const double scale = force_scale(actions);
    const auto evaluate = [&](const std::vector<double>& at, double& energy) {
        system_.gradient(actions, lane_inertia, theta_pack.data(), at.data(), w.lane_gradient.data(),
                         w.lane_energy.data(), kPackLanes, 1);
        energy = w.lane_energy[0];
        double sum = 0.0;
        for (std::size_t d = 0; d < dofs; ++d) sum += w.lane_gradient[d * kPackLanes] * w.lane_gradient[d * kPackLanes];
        return std::sqrt(sum);
    };
    double energy = 0.0;
    double norm = evaluate(alone, energy);
    const auto& pattern = system_.pattern();
    const auto may_go_on = [&] {
        return settings_.newton_budget == 0 || report.newton_steps < settings_.newton_budget;
    };
    int iteration = 0;
    for (; iteration < settings_.max_newton_iterations && !(norm <= settings_.relative_residual * scale) && may_go_on();
         ++iteration, ++report.newton_steps) {
        for (std::size_t d = 0; d < dofs; ++d) w.positions.data()[d] = alone[d * kPackLanes];
        if (!system_.tangent(actions, lane_inertia, 0, theta_one.data(), w.positions, w.values)) break;
        if (!w.own->factorise_shifted(w.values, report.factorisations)) break;
        auto rhs = w.rhs.leftCols(1);
        for (std::size_t i = 0; i < system_.num_nodes(); ++i)
            if (const auto row = pattern.free_index(static_cast<NodeIndex>(i)); row >= 0)
                for (std::size_t a = 0; a < 3; ++a)
                    rhs(3 * row + static_cast<Eigen::Index>(a), 0) = w.lane_gradient[(3 * i + a) * kPackLanes];
        w.residual = rhs.col(0);
        w.own->solve(rhs);
        const double slope = w.residual.dot(rhs.col(0));
        double step = 1.0;
        bool accepted = false;
        for (int backtrack = 0; backtrack <= kMaxBacktracks && !accepted; ++backtrack, step *= 0.5) {
            w.lane_trial = alone;
            for (std::size_t i = 0; i < system_.num_nodes(); ++i)
                if (const auto row = pattern.free_index(static_cast<NodeIndex>(i)); row >= 0)
                    for (std::size_t a = 0; a < 3; ++a)
                        for (std::size_t l = 0; l < kPackLanes; ++l)
                            w.lane_trial[(3 * i + a) * kPackLanes + l] -=
                                step * rhs(3 * row + static_cast<Eigen::Index>(a), 0);
            double trial_energy = 0.0;
            const double trial_norm = evaluate(w.lane_trial, trial_energy);
            const bool at_noise = trial_energy <= energy + 100.0 * kEnergyNoise * std::abs(energy) && trial_norm < norm;
            if (std::isfinite(trial_norm) && (trial_energy <= energy - kArmijo * step * slope || at_noise)) {
                alone.swap(w.lane_trial);
                energy = trial_energy;
                norm = trial_norm;
                accepted = true;
            }
        }
        if (!accepted) break;
    }
    for (std::size_t d = 0; d < dofs; ++d) x[d * stride + lane] = alone[d * kPackLanes];
    if (damping != nullptr) damping->target = batch_damping_target;
    report.iterations = std::max(report.iterations, iteration);
    report.relative_residual = std::max(report.relative_residual, norm / scale);
    return norm <= settings_.relative_residual * scale;
}

}  // namespace teres
