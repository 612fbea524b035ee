#include "plugins/diagnosis/joint_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr double kHuber = 3.0;        // weight falls from here on, in medians of the marker distances
constexpr double kMaxStep = 2.0;      // of a scaled coordinate in one iteration: keeps linearised steps in reach
constexpr double kMaxDamping = 1e6;
constexpr int kTrials = 3;            // in a row that are worse, with ever shorter steps
constexpr double kGoodShare = 0.5;    // of the promised decrease: less, and the derivatives are made anew

// Square roots of Huber weights per trajectory row: marker distances against their median.
Eigen::VectorXd huber_roots(const Eigen::VectorXd& difference) {
    Eigen::VectorXd root = Eigen::VectorXd::Ones(difference.size());
    std::vector<double> distance, finite;
    for (Eigen::Index row = 0; row + 2 < difference.size(); row += 3) {
        distance.push_back(difference.segment<3>(row).norm());
        if (std::isfinite(distance.back())) finite.push_back(distance.back());
    }
    if (finite.empty()) return root;
    const auto middle = finite.begin() + static_cast<std::ptrdiff_t>(finite.size() / 2);
    std::nth_element(finite.begin(), middle, finite.end());
    const double bound = kHuber * *middle;
    for (std::size_t m = 0; m < distance.size(); ++m)
        if (distance[m] > bound)
            root.segment<3>(static_cast<Eigen::Index>(3 * m)).setConstant(std::sqrt(bound / distance[m]));
    return root;
}

Eigen::VectorXd zero_where_lost(const Eigen::VectorXd& v) { return v.array().isFinite().select(v, 0.0); }

// dh/du of the trajectory about the simulator's base, which must be `at`.
Eigen::MatrixXd derivative(Simulator& simulator, const FitSpace& space, const Assumption& at) {
    Eigen::VectorXd step;
    const auto others = space.neighbours(space.coordinates(at), step);
    const Eigen::VectorXd scale = space.prior_stdev().cwiseQuotient(step);
    return simulator.responses(others) * scale.asDiagonal();
}

}  // namespace

Eigen::VectorXd Fit::stdev(double tempering) const {
    const Eigen::MatrixXd information =
        Eigen::MatrixXd::Identity(J.cols(), J.cols()) + tempering * J.transpose() * J;
    return information.inverse().diagonal().cwiseSqrt();
}

Fit fit_jointly(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed,
                const Assumption& start, const FitOptions& options) {
    const FitSpace space(simulator.mechanics(), simulator.effects(), start);
    const auto coordinates = [&](const Eigen::VectorXd& u) -> Eigen::VectorXd {
        return space.prior_mean() + space.prior_stdev().cwiseProduct(u);
    };
    Eigen::VectorXd weight = Eigen::VectorXd::Ones(observed.size());
    const auto weigh = [&](Fit& fit) {
        fit.residual = whitener(weight.cwiseProduct(zero_where_lost(observed - fit.trajectory)));
        fit.misfit = fit.residual.squaredNorm();
        fit.cost = fit.misfit + fit.u.squaredNorm();
    };
    const auto evaluate = [&](const Eigen::VectorXd& u) {
        Fit fit;
        fit.at = space.assumption(coordinates(u));
        fit.u = (space.coordinates(fit.at) - space.prior_mean()).cwiseQuotient(space.prior_stdev());  // within bounds
        fit.usable = simulator.approximate(fit.at, fit.trajectory);
        if (!fit.usable) {
            fit.cost = std::numeric_limits<double>::infinity();
            return fit;
        }
        weigh(fit);
        return fit;
    };
    // dh/du of the trajectory: first order about the simulator's base, secant updates (Broyden) while they predict well.
    Eigen::MatrixXd H;
    bool exact = false;
    const auto linearise = [&](const Fit& fit) {
        if (simulator.base().theta != fit.at.theta || simulator.base().effects != fit.at.effects) evaluate(fit.u);
        H = derivative(simulator, space, fit.at);
        exact = true;
    };

    Fit best = evaluate((space.coordinates(start) - space.prior_mean()).cwiseQuotient(space.prior_stdev()));
    if (!best.usable) return best;
    linearise(best);
    double damping = 0.0;
    int trials = 0;
    for (int iteration = 0; iteration < options.max_iterations && trials < kTrials && damping < kMaxDamping;) {
        if (options.robust) {
            weight = huber_roots(observed - best.trajectory);
            weigh(best);
        }
        best.J = whitener(weight.asDiagonal() * H);
        // (J'J + I + damping) du = J'r - u
        Eigen::MatrixXd normal = best.J.transpose() * best.J + Eigen::MatrixXd::Identity(best.J.cols(), best.J.cols());
        normal.diagonal() *= 1.0 + damping;
        Eigen::VectorXd du = normal.ldlt().solve(best.J.transpose() * best.residual - best.u);
        du *= std::min(1.0, kMaxStep / std::max(du.cwiseAbs().maxCoeff(), 1e-300));
        const double promised = best.cost - (best.residual - best.J * du).squaredNorm() - (best.u + du).squaredNorm();
        if (promised < options.tolerance * best.cost) {
            if (exact || promised < 0.1 * options.tolerance * best.cost) break;
            linearise(best);  // before giving up
            continue;
        }
        Fit next = evaluate(best.u + du);
        if (next.cost < best.cost) {
            const double gained = best.cost - next.cost;
            const bool enough = gained >= options.tolerance * best.cost;
            const Eigen::VectorXd taken = next.u - best.u;
            if (taken.squaredNorm() > 0.0)
                H += (next.trajectory - best.trajectory - H * taken) * taken.transpose() / taken.squaredNorm();
            exact = false;
            best = std::move(next);
            damping *= 0.1;
            trials = 0;
            ++iteration;
            if (!enough) break;
            if (gained < kGoodShare * promised) linearise(best);
        } else if (!exact) {
            linearise(best);
        } else {
            damping = std::max(0.1, 10.0 * damping);
            ++trials;
        }
    }
    if (options.robust) {  // every marker at full weight
        weight.setOnes();
        weigh(best);
    }
    best.J = whitener(weight.asDiagonal() * H);
    return best;
}

void complete(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit) {
    fit.usable = simulator.simulate(fit.at, fit.trajectory);
    if (!fit.usable) return;
    const FitSpace space(simulator.mechanics(), simulator.effects(), fit.at);
    fit.residual = whitener(zero_where_lost(observed - fit.trajectory));
    fit.misfit = fit.residual.squaredNorm();
    fit.cost = fit.misfit + fit.u.squaredNorm();
    fit.J = whitener(derivative(simulator, space, fit.at));
}

}  // namespace teres
