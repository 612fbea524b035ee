#include "plugins/diagnosis/joint_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr double kHuber = 3.0;        // weight falls from here on, in medians of the marker distances
constexpr double kMaxStep = 2.0;      // of a scaled coordinate in one iteration: keeps linearised steps in reach
constexpr double kMaxDamping = 1e6;
constexpr int kTrials = 3;

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
    const auto evaluate = [&](const Eigen::VectorXd& u) {
        Fit fit;
        fit.at = space.assumption(coordinates(u));
        fit.u = (space.coordinates(fit.at) - space.prior_mean()).cwiseQuotient(space.prior_stdev());  // within bounds
        fit.usable = simulator.approximate(fit.at, fit.trajectory);
        if (!fit.usable) {
            fit.cost = std::numeric_limits<double>::infinity();
            return fit;
        }
        const Eigen::VectorXd difference = zero_where_lost(observed - fit.trajectory);
        fit.residual = whitener(weight.cwiseProduct(difference));
        fit.misfit = fit.residual.squaredNorm();
        fit.cost = fit.misfit + fit.u.squaredNorm();
        return fit;
    };
    const auto linearise = [&](Fit& fit) {  // about the simulator's base, which must be fit.at
        Eigen::VectorXd step;
        const auto others = space.neighbours(space.coordinates(fit.at), step);
        const Eigen::VectorXd scale = space.prior_stdev().cwiseQuotient(step);
        fit.J = whitener(weight.asDiagonal() * simulator.responses(others)) * scale.asDiagonal();
    };

    Fit best = evaluate((space.coordinates(start) - space.prior_mean()).cwiseQuotient(space.prior_stdev()));
    if (!best.usable) return best;
    double damping = 0.0;
    bool linearised = false;
    for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
        if (options.robust) {
            const Eigen::VectorXd difference = zero_where_lost(observed - best.trajectory);
            weight = huber_roots(observed - best.trajectory);
            best.residual = whitener(weight.cwiseProduct(difference));
            best.misfit = best.residual.squaredNorm();
            best.cost = best.misfit + best.u.squaredNorm();
        }
        linearise(best);
        linearised = true;
        // (J'J + I + damping) du = J'r - u
        const Eigen::MatrixXd H = best.J.transpose() * best.J + Eigen::MatrixXd::Identity(best.J.cols(), best.J.cols());
        const Eigen::VectorXd gradient = best.J.transpose() * best.residual - best.u;
        double decrease = 0.0;
        for (int trial = 0; trial < kTrials && damping < kMaxDamping; ++trial) {
            Eigen::MatrixXd damped = H;
            damped.diagonal() += damping * H.diagonal();
            Eigen::VectorXd du = damped.ldlt().solve(gradient);
            // what the linear model promises: not worth a simulation if it is nothing
            if (best.cost - (best.residual - best.J * du).squaredNorm() - (best.u + du).squaredNorm() <
                options.tolerance * best.cost)
                break;
            du *= std::min(1.0, kMaxStep / std::max(du.cwiseAbs().maxCoeff(), 1e-300));
            Fit next = evaluate(best.u + du);
            if (next.cost < best.cost) {
                decrease = 1.0 - next.cost / best.cost;
                best = std::move(next);
                damping *= 0.1;
                linearised = false;
                break;
            }
            damping = std::max(0.1, 10.0 * damping);
        }
        if (linearised || decrease < options.tolerance) break;
    }
    // The simulator's base and J at the result, with every marker at full weight.
    if (options.robust) {
        weight.setOnes();
        linearised = false;
    }
    if (simulator.base().theta != best.at.theta || simulator.base().effects != best.at.effects || options.robust) {
        Eigen::MatrixXd J = std::move(best.J);
        best = evaluate(best.u);
        best.J = std::move(J);
    }
    if (best.usable && !linearised) linearise(best);
    return best;
}

}  // namespace teres
