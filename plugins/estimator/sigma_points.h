// Sigma points of the unit Gaussian N(0, 1) in p dimensions: deterministic samples that carry mean and
// covariance exactly.
//
//     sum_i w_i = 1        sum_i w_i I_i = 0        sum_i w_i I_i I_i^T = 1
//
// simplex  r = p+1  all weights 1/r (Moireau and Chapelle 2011, section 3.3; construction in README.md)
// star     r = 2p+1 centre, then +-sqrt(p+lambda) e_i; weights lambda/(p+lambda), 1/(2(p+lambda))
#pragma once

#include <Eigen/Dense>

namespace teres {

enum class SigmaPointKind {
    kSimplex,
    kStar,
    /// A star as a known implementation weighs it: 1/(2(p+lambda)) for every point, the centre too. The
    /// weights sum to 1, and the mean is unbiased, for lambda = 1/2 only. Kept to reproduce its recorded
    /// runs.
    kStarConstantWeight,
    /// A simplex as the same implementation draws it with "unbiased variance": the points at (r-1)/r of their
    /// distance, the deviations of the state weighted by 1/r, those of the observation by 1/(r-1). Kept to
    /// reproduce, not to use.
    kSimplexMixedWeights,
};

struct SigmaPoints {
    Eigen::MatrixXd unit;             ///< p x r, column I_i
    Eigen::VectorXd weights;          ///< r
    double observation_factor = 1.0;  ///< on the weights of observed deviations
};

/// p >= 1; star: lambda >= 0, so that no weight is negative (a negative one could cost the covariance its
/// sign).
SigmaPoints make_sigma_points(SigmaPointKind kind, Eigen::Index p, double lambda = 1.0);

}  // namespace teres
