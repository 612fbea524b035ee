#include "plugins/diagnosis/joint_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr double kHuber = 3.0;        // weight falls from here on, in medians of the marker distances
constexpr double kMaxStep = 2.5;      // of a scaled coordinate in one iteration: keeps linearised steps in reach
constexpr double kDamping = 1e-2;     // at the start
constexpr double kGrowth = 4.0;       // of the damping after a step that was worse; doubled when it happens again
constexpr double kFarFromBase = 1.0;  // scaled coordinates from where the tangents were made: they no longer serve
constexpr double kNoMove = 1e-9;      // scaled coordinates
constexpr double kMaxDamping = 1e6;
constexpr double kSaysNothing = 1e-3;  // information on a scaled coordinate, whose prior's is 1
constexpr int kLeastIterations = 4;    // also when the time is used up
constexpr int kPatience = 2;           // steps whose gain tells what the next ones can bring

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

Eigen::VectorXd zero_where_lost(const Eigen::VectorXd& v) {
    return v.array().isFinite().select(v, 0.0);
}

// dh/du of the trajectory about the simulator's base, which must be `at`; T: of the settled coordinates.
Eigen::MatrixXd derivative(Simulator& simulator, const FitSpace& space, const Assumption& at, Eigen::MatrixXd& T) {
    Eigen::VectorXd step;
    const Eigen::VectorXd from = space.coordinates(at);
    const auto others = space.neighbours(from, step);
    T.resize(space.size(), space.size());
    for (Eigen::Index k = 0; k < space.size(); ++k)
        T.col(k) = (space.coordinates(others[static_cast<std::size_t>(k)]) - from).cwiseQuotient(space.prior_stdev());
    const Eigen::VectorXd scale = space.prior_stdev().cwiseQuotient(step);
    T *= scale.asDiagonal();
    return simulator.responses(others) * scale.asDiagonal();
}

// 1 where a coordinate moves the body, 0 where it changes how the body is seen.
Eigen::VectorXd mechanical_coordinates(const Simulator& simulator, const FitSpace& space, const Assumption& at) {
    Eigen::VectorXd moves = Eigen::VectorXd::Ones(space.size());
    for (std::size_t k = 0; k < at.effects.size(); ++k)
        if (simulator.effects()[at.effects[k].entry].sensor)
            moves.segment(space.coordinate(k, 0), static_cast<Eigen::Index>(at.effects[k].values.size())).setZero();
    return moves;
}

// A quarter of the recording, half of it, all of it: each fit starts where the one before ended.
Fit fit_growing(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed,
                const Assumption& start, FitOptions options) {
    options.growing = false;
    Fit fit;
    fit.at = start;
    for (const std::size_t share : {4, 2, 1}) {
        options.num_frames = simulator.num_frames() / share;
        Fit longer = fit_jointly(simulator, whitener, observed, fit.at, options);
        if (longer.usable || share == 1) fit = std::move(longer);
    }
    return fit;
}

}  // namespace

bool Fit::says_nothing_of(Eigen::Index coordinate) const {
    return J.col(coordinate).squaredNorm() < kSaysNothing;
}

Eigen::VectorXd Fit::stdev(double tempering) const {
    const Eigen::MatrixXd information = Eigen::MatrixXd::Identity(J.cols(), J.cols()) + tempering * J.transpose() * J;
    return (T * information.ldlt().solve(T.transpose())).diagonal().cwiseMax(0.0).cwiseSqrt();
}

Fit fit_jointly(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed,
                const Assumption& start, const FitOptions& options) {
    if (options.growing) return fit_growing(simulator, whitener, observed, start, options);
    const FitSpace space(simulator.mechanics(), simulator.effects(), start);
    const auto coordinates = [&](const Eigen::VectorXd& u) -> Eigen::VectorXd {
        return space.prior_mean() + space.prior_stdev().cwiseProduct(u);
    };
    const Horizon horizon(simulator, options.num_frames);
    Eigen::VectorXd used = Eigen::VectorXd::Ones(observed.size());
    if (options.num_frames > 0)
        used.tail(used.size() - static_cast<Eigen::Index>(3 * simulator.num_markers() * options.num_frames)).setZero();
    Eigen::VectorXd weight = used;
    const auto weigh = [&](Fit& fit) {
        fit.residual = whitener(weight.cwiseProduct(zero_where_lost(observed - fit.trajectory)));
        fit.misfit = fit.residual.squaredNorm();
        fit.cost = fit.misfit + fit.u.squaredNorm();
    };
    const auto scaled = [&](const Assumption& at) -> Eigen::VectorXd {
        return (space.coordinates(at) - space.prior_mean()).cwiseQuotient(space.prior_stdev());
    };
    const auto evaluate = [&](const Eigen::VectorXd& u) {
        Fit fit;
        if (!u.allFinite()) {
            fit.cost = std::numeric_limits<double>::infinity();
            return fit;
        }
        fit.at = space.assumption(coordinates(u));
        fit.u = scaled(fit.at);  // within bounds
        fit.usable = simulator.approximate(fit.at, fit.trajectory);
        if (!fit.usable) {
            fit.cost = std::numeric_limits<double>::infinity();
            return fit;
        }
        weigh(fit);
        return fit;
    };
    const auto misfit_and_ligaments = [&](const Fit& fit) {
        return fit.misfit + fit.u.head(static_cast<Eigen::Index>(start.theta.size())).squaredNorm();
    };
    Eigen::MatrixXd H, T;  // dh/du of the trajectory, of the settled coordinates
    bool current = false;
    const Eigen::VectorXd moves = mechanical_coordinates(simulator, space, start);
    Eigen::VectorXd base_u = scaled(start);
    bool rebased = false;
    const auto linearise = [&](Fit& fit) {
        if (simulator.base().theta != fit.at.theta || simulator.base().effects != fit.at.effects) evaluate(fit.u);
        if (!simulator.mechanics().dynamic() &&
            moves.cwiseProduct(fit.u - base_u).lpNorm<Eigen::Infinity>() > kFarFromBase) {
            simulator.rebase();
            base_u = fit.u;
            rebased = true;
        }
        H = derivative(simulator, space, fit.at, T);
        current = true;
    };

    // Solves A du = b; a coordinate that stands at its bound and would go beyond stays there, the others go on without
    // it.
    const auto step_within_bounds = [&](const Fit& from, Eigen::MatrixXd A, Eigen::VectorXd b) {
        Eigen::VectorXd du;
        for (Eigen::Index held = -1; held < b.size(); ++held) {
            du = A.ldlt().solve(b);
            const Eigen::VectorXd moved = scaled(space.assumption(coordinates(from.u + du))) - from.u;
            bool again = false;
            for (Eigen::Index k = 0; k < du.size(); ++k)
                if (du(k) != 0.0 && std::abs(moved(k)) < kNoMove && std::abs(du(k)) > kNoMove) {
                    A.row(k).setZero();
                    A.col(k).setZero();
                    A(k, k) = 1.0;
                    b(k) = 0.0;
                    again = true;
                }
            if (!again) break;
        }
        return du;
    };

    Fit best = evaluate(scaled(start));
    if (!best.usable) return best;
    double damping = kDamping, growth = kGrowth;
    bool given_up = false;
    std::vector<double> course{misfit_and_ligaments(best)};
    for (int iteration = 0; iteration < options.max_iterations && damping < kMaxDamping; ++iteration) {
        if (iteration >= kLeastIterations && options.limit != nullptr && options.limit->reached()) break;
        if (options.robust) {
            weight = used.cwiseProduct(huber_roots(observed - best.trajectory));
            weigh(best);
        }
        if (!current) linearise(best);
        best.J = whitener(weight.asDiagonal() * H);
        // (J'J + T'T + damping) du = J'r - T'u; what T leaves out leads nowhere and does not move.
        const Eigen::MatrixXd nowhere = Eigen::MatrixXd::Identity(T.rows(), T.cols()) - T;
        const Eigen::MatrixXd normal = best.J.transpose() * best.J + T.transpose() * T + nowhere.transpose() * nowhere;
        Eigen::VectorXd gradient = best.J.transpose() * best.residual - T.transpose() * best.u;
        // An effect's coordinate of which the recording says nothing here stays: an instant between two frames would
        // be drawn to the middle of the recording.
        for (auto k = static_cast<Eigen::Index>(start.theta.size()); k < gradient.size(); ++k)
            if (best.says_nothing_of(k)) gradient(k) = 0.0;
        const auto promised = [&](const Eigen::VectorXd& du) {
            return best.cost - (best.residual - best.J * du).squaredNorm() - (best.u + T * du).squaredNorm();
        };
        if (promised(step_within_bounds(best, normal, gradient)) < options.tolerance * best.cost) break;
        Eigen::MatrixXd damped = normal;
        damped.diagonal() *= 1.0 + damping;
        Eigen::VectorXd du = step_within_bounds(best, damped, gradient);
        du *= std::min(1.0, kMaxStep / std::max(du.lpNorm<Eigen::Infinity>(), 1e-300));
        Fit next = evaluate(best.u + du);
        const double ratio = (best.cost - next.cost) / promised(du);
        if (ratio > 0.0) {  // H. B. Nielsen's update of the damping
            const double gained = best.cost - next.cost;
            damping *= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * ratio - 1.0, 3));
            growth = kGrowth;
            current = false;
            best = std::move(next);
            if (gained < 0.1 * options.tolerance * best.cost) break;
        } else {
            damping *= growth;
            growth *= kGrowth;
        }
        course.push_back(misfit_and_ligaments(best));
        if (iteration < kPatience) continue;
        const double gained = course[course.size() - 1 - kPatience] - course.back();
        const double ahead = course.back() - gained / kPatience * (options.max_iterations - iteration);
        given_up = options.hopeless && options.hopeless(best.residual, ahead);
        if (given_up) break;
    }
    if (rebased && !given_up) {  // frames between those solved come from far
        best.usable = simulator.simulate(best.at, best.trajectory);
        if (!best.usable) return best;
        weigh(best);
        base_u = best.u;
        current = false;
    }
    if (options.robust) {  // every marker at full weight
        weight = used;
        weigh(best);
    }
    if (!current) linearise(best);
    best.J = whitener(weight.asDiagonal() * H);
    best.T = T;
    return best;
}

void complete(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit) {
    fit.usable = simulator.simulate(fit.at, fit.trajectory);
    if (!fit.usable) return;
    const FitSpace space(simulator.mechanics(), simulator.effects(), fit.at);
    fit.residual = whitener(zero_where_lost(observed - fit.trajectory));
    fit.misfit = fit.residual.squaredNorm();
    fit.cost = fit.misfit + fit.u.squaredNorm();
    fit.J = whitener(derivative(simulator, space, fit.at, fit.T));
}

}  // namespace teres
