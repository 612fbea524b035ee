// How far the parameters may have moved since the last frame: what keeps the filter awake. In filter
// coordinates, with the prior's standard deviation s0 of each parameter and P the covariance before the
// frame:
//
//     random walk   Q_ii = (noise_per_sqrt_s s0_i)^2 dt
//     forgetting    P <- D P D,  D_ii = exp(dt / (2 T))                 old frames lose weight with time
//     constant T re-inflation  Q_ii += max(reinflation s0_i, reinflation_stdev)^2  once after an inconsistent
//     frame
//
// Walk and forgetting stop at the prior's variance: a parameter that nobody observes does not become less
// known than before the first frame. So does re-inflation, unless reinflation_stdev asks for more (a prior
// can be narrow and wrong).
#pragma once

#include <Eigen/Dense>

namespace teres {

class ParameterWalk {
  public:
    struct Options {
        double noise_per_sqrt_s = 0.0;   ///< >= 0, in prior standard deviations
        double forgetting_time_s = 0.0;  ///< T > 0, or 0: nothing is forgotten
        double reinflation = 0.5;        ///< >= 0, in prior standard deviations
        double reinflation_stdev = 0.0;  ///< >= 0, in filter coordinates
    };
    struct Change {
        Eigen::VectorXd factor;          ///< D, each >= 1
        Eigen::VectorXd noise_variance;  ///< diagonal of Q, each >= 0
    };

    ParameterWalk(Options options, const Eigen::VectorXd& prior_stdev) : options_(options), prior_stdev_(prior_stdev) {}

    /// variance: diagonal of P. dt_s >= 0. inconsistent: the last frame contradicted the filter.
    Change over(double dt_s, const Eigen::VectorXd& variance, bool inconsistent) const;

  private:
    Options options_;
    Eigen::VectorXd prior_stdev_;
};

}  // namespace teres
