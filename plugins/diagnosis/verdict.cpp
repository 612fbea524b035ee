#include "plugins/diagnosis/verdict.h"

#include <algorithm>
#include <cmath>

namespace teres {

double refit_score(const Fit& nominal, Cause& cause, const EffectTable& effects, const ErrorFloor& floor,
                   const Calibration& calibration) {
    // Scaled coordinates and columns of the amplitudes; place and time have been paid for by the search.
    const Fit& fit = cause.fit;
    const Eigen::Index theta = nominal.u.size();
    std::vector<Eigen::Index> amplitude;
    Eigen::Index column = theta;
    for (const std::size_t e : cause.entries)
        for (const EffectParameter& p : effects[e].parameters) {
            if (p.role == EffectRole::kAmplitude) amplitude.push_back(column);
            ++column;
        }
    const Eigen::MatrixXd J = fit.J.leftCols(theta), G = fit.J(Eigen::all, amplitude);
    const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(theta, theta) + J.transpose() * J;
    const Eigen::MatrixXd S = G.transpose() * G - G.transpose() * J * H.ldlt().solve(J.transpose() * G);
    cause.price = {tail_price(fit.u(amplitude)),
                   occam_price(calibration.nu / floor.above(fit.cost) * S, cause.entries.size()), cause.search_cost,
                   calibration.further_effect * static_cast<double>(cause.entries.size() - 1)};
    cause.misfit = fit.cost - fit.u.tail(fit.u.size() - theta).squaredNorm();
    return -0.5 * calibration.nu * std::log(floor.above(cause.misfit) / floor.above(nominal.cost)) -
           cause.price.total();
}

double explained_share(double cost_null, double cost, const ErrorFloor& floor) {
    const double excess = cost_null - floor.total();
    return excess <= 0.0 ? 0.0 : std::clamp((cost_null - cost) / excess, 0.0, 1.0);
}

Verdict judge(std::vector<Cause> causes, double cost_null, const ErrorFloor& floor, const Calibration& calibration) {
    Verdict verdict;
    const double reached = std::min(floor.total(), cost_null);
    const double rest = reached + calibration.unknown_share * (cost_null - reached);
    const double gain = -0.5 * calibration.nu * std::log(floor.above(rest) / floor.above(cost_null));
    const auto best = std::max_element(causes.begin(), causes.end(), [](const Cause& a, const Cause& b) {
        return (a.fit.usable ? a.score : -1e9) < (b.fit.usable ? b.score : -1e9);
    });
    const double best_price = best != causes.end() && best->fit.usable ? best->price.total() : 0.0;
    const double unknown = gain - std::max(calibration.unknown_price, best_price);

    // Which cause, if there is one.
    double top = unknown;
    for (const Cause& cause : causes) top = std::max(top, cause.score);
    double sum = std::exp(unknown - top);
    for (const Cause& cause : causes) sum += std::exp(cause.score - top);
    // Whether there is one.
    const double something = std::max(top + std::log(sum), gain - calibration.unknown_price);
    verdict.none_probability = 1.0 / (1.0 + std::exp(something - calibration.none_bonus));
    verdict.unknown_probability = (1.0 - verdict.none_probability) * std::exp(unknown - top) / sum;
    for (Cause& cause : causes)
        cause.probability = (1.0 - verdict.none_probability) * std::exp(cause.score - top) / sum;
    // Tempered.
    double total = 0.0;
    const auto temper = [&](double& p) { total += p = std::pow(p, 1.0 / calibration.temperature); };
    const auto normalise = [&](double& p) { p /= total; };
    const auto all = [&](const auto& change) {
        change(verdict.none_probability);
        change(verdict.unknown_probability);
        for (Cause& cause : causes) change(cause.probability);
    };
    all(temper);
    all(normalise);
    std::sort(causes.begin(), causes.end(),
              [](const Cause& a, const Cause& b) { return a.probability > b.probability; });
    verdict.causes = std::move(causes);
    return verdict;
}

}  // namespace teres
