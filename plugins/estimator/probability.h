// The normal and the chi-square distribution: gates, consistency bounds, attachment probabilities.
#pragma once

namespace teres {

double normal_cdf(double z);
/// Inverse of normal_cdf; p in (0, 1), cut to [1e-15, 1 - 1e-15].
double probit(double p);
/// P(chi2_k <= x), k > 0.
double chi_square_cdf(double x, double degrees_of_freedom);
/// Inverse of chi_square_cdf; p in [0, 1), cut to 1 - 1e-12.
double chi_square_quantile(double p, double degrees_of_freedom);

}  // namespace teres
