#include "plugins/diagnosis/shape_search.h"

#include <array>

namespace teres {
namespace {

constexpr std::array kMoves{0.16, 0.08, 0.04, 0.02, 0.01};  // in prior standard deviations, both ways
constexpr int kRounds = 3;
constexpr double kWorthMoving = 0.01;  // of the misfit

}  // namespace

void improve_shapes(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit) {
    if (fit.at.effects.empty()) return;
    const std::size_t last = fit.at.effects.size() - 1;
    const EffectEntry& entry = simulator.effects()[fit.at.effects[last].entry];
    if (!entry.sensor && !entry.info.event) return;
    const FitSpace space(simulator.mechanics(), simulator.effects(), fit.at);
    for (int round = 0; round < kRounds; ++round) {
        std::vector<Assumption> others;
        for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
            if (entry.parameters[p].role == EffectRole::kAmplitude) continue;
            const Eigen::Index column = space.coordinate(last, p);
            for (const double move : kMoves)
                for (const double sign : {-1.0, 1.0}) {
                    Eigen::VectorXd at = space.coordinates(fit.at);
                    at(column) += sign * move * space.prior_stdev()(column);
                    others.push_back(space.assumption(at));
                }
        }
        if (others.empty()) return;
        simulator.approximate(fit.at, fit.trajectory);
        const Eigen::MatrixXd change = whitener(simulator.responses(others));
        const Eigen::VectorXd costs = (change.colwise() - fit.residual).colwise().squaredNorm();
        Eigen::Index best = 0;
        if (costs.minCoeff(&best) >= fit.misfit * (1.0 - kWorthMoving)) return;
        Fit moved =
            fit_jointly(simulator, whitener, observed, others[static_cast<std::size_t>(best)], {2, 0.01, false});
        if (!moved.usable || moved.cost >= fit.cost) return;
        fit = std::move(moved);
    }
}

}  // namespace teres
