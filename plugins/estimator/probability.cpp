#include "plugins/estimator/probability.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// Regularised lower incomplete gamma P(a, x): series for x < a + 1, continued fraction (modified Lentz)
// above.
double regularised_gamma(double a, double x) {
    if (!(x > 0.0)) return 0.0;
    const double front = std::exp(a * std::log(x) - x - std::lgamma(a));
    constexpr int kMaxTerms = 10000;
    if (x < a + 1.0) {
        double term = 1.0 / a, sum = term;
        for (int n = 1; n < kMaxTerms && std::abs(term) > kEpsilon * std::abs(sum); ++n) {
            term *= x / (a + n);
            sum += term;
        }
        return std::min(1.0, front * sum);
    }
    constexpr double kTiny = 1e-300;
    double b = x + 1.0 - a, c = 1.0 / kTiny, d = 1.0 / b, h = d;
    for (int n = 1; n < kMaxTerms; ++n) {
        const double an = -n * (n - a);
        b += 2.0;
        d = an * d + b;
        if (std::abs(d) < kTiny) d = kTiny;
        c = b + an / c;
        if (std::abs(c) < kTiny) c = kTiny;
        d = 1.0 / d;
        h *= d * c;
        if (std::abs(d * c - 1.0) < kEpsilon) break;
    }
    return std::clamp(1.0 - front * h, 0.0, 1.0);
}

// Increasing f: bisection to full precision of x; at most 200 halvings.
template <class F>
double invert(const F& f, double target, double low, double high) {
    for (int i = 0; i < 200 && high - low > kEpsilon * (std::abs(low) + std::abs(high)); ++i) {
        const double middle = 0.5 * (low + high);
        (f(middle) < target ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

}  // namespace

double normal_cdf(double z) {
    return 0.5 * std::erfc(-z / std::sqrt(2.0));
}

double probit(double p) {
    p = std::clamp(p, 1e-15, 1.0 - 1e-15);
    // The lower tail keeps its digits in erfc; the upper follows by symmetry.
    if (p > 0.5) return -probit(1.0 - p);
    return invert(normal_cdf, p, -9.0, 0.0);
}

double chi_square_cdf(double x, double degrees_of_freedom) {
    return regularised_gamma(0.5 * degrees_of_freedom, 0.5 * x);
}

double chi_square_quantile(double p, double degrees_of_freedom) {
    p = std::clamp(p, 0.0, 1.0 - 1e-12);
    if (p == 0.0) return 0.0;
    double high = degrees_of_freedom + 1.0;
    while (chi_square_cdf(high, degrees_of_freedom) < p) high *= 2.0;
    return invert([&](double x) { return chi_square_cdf(x, degrees_of_freedom); }, p, 0.0, high);
}

}  // namespace teres
