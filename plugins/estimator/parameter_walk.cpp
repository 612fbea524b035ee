#include "plugins/estimator/parameter_walk.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace teres {

ParameterWalk::Change ParameterWalk::over(double dt_s, const Eigen::VectorXd& variance, bool inconsistent) const {
    TERES_CHECK(dt_s >= 0.0);
    TERES_CHECK(variance.size() == prior_stdev_.size());
    Change change{Eigen::VectorXd::Ones(variance.size()), Eigen::VectorXd::Zero(variance.size())};
    for (Eigen::Index i = 0; i < variance.size(); ++i) {
        const double prior = prior_stdev_(i) * prior_stdev_(i);
        if (options_.forgetting_time_s > 0.0 && variance(i) > 0.0 && variance(i) < prior)
            change.factor(i) =
                std::min(std::exp(0.5 * dt_s / options_.forgetting_time_s), std::sqrt(prior / variance(i)));
        const double remembered = variance(i) * change.factor(i) * change.factor(i);
        const double room = std::max(0.0, prior - remembered);
        double noise = std::pow(options_.noise_per_sqrt_s * prior_stdev_(i), 2) * dt_s;
        if (inconsistent) noise += std::pow(options_.reinflation * prior_stdev_(i), 2);
        noise = std::min(noise, room);
        if (inconsistent) noise = std::max(noise, std::pow(options_.reinflation_stdev, 2) - remembered);
        change.noise_variance(i) = noise;
    }
    return change;
}

}  // namespace teres
