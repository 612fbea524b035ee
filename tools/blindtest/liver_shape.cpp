#include "tools/blindtest/liver_shape.h"

#include <algorithm>
#include <cmath>

namespace teres::blindtest {
namespace {
constexpr double kBlend = 0.012;  // [m] rounding of the union and of the hollow
}  // namespace

// First-order distance: k0 (k0 - 1) / k1, k0 = |p/r|, k1 = |p/r^2|.
double LiverShape::Ellipsoid::level(const Point& p) const {
    double k0 = 0.0, k1 = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double q = (p[i] - centre_m[i]) / semi_axes_m[i];
        k0 += q * q;
        k1 += q * q / (semi_axes_m[i] * semi_axes_m[i]);
    }
    k0 = std::sqrt(k0);
    return k0 * (k0 - 1.0) / std::max(std::sqrt(k1), 1e-12);
}

LiverShape::LiverShape(Random& random) {
    parts_ = {{{-0.046, -0.020, 0.004}, {0.040, 0.056, 0.038}},  // right lobe
              {{-0.036, 0.022, -0.006}, {0.050, 0.044, 0.050}},  // dome
              {{0.006, 0.030, 0.004}, {0.046, 0.034, 0.038}},    // bridge
              {{0.048, 0.034, 0.012}, {0.042, 0.026, 0.026}}};   // left lobe
    hollow_ = {{0.024, -0.040, -0.060}, {0.054, 0.044, 0.044}};
    for (Ellipsoid& part : parts_) {
        for (std::size_t i = 0; i < 3; ++i) {
            part.centre_m[i] += random.uniform(-0.004, 0.004);
            part.semi_axes_m[i] *= random.uniform(0.92, 1.10);
        }
    }
    scale_ = random.uniform(0.90, 1.12);
}

double LiverShape::level(const Point& world) const {
    const Point p = times(1.0 / scale_, world);
    // -B log sum exp(-d/B) joins the parts, +B log(exp(u/B) + exp(-h/B)) takes the hollow away.
    double low = 1e9, sum = 0.0;
    for (const Ellipsoid& part : parts_) low = std::min(low, part.level(p));
    for (const Ellipsoid& part : parts_) sum += std::exp(-(part.level(p) - low) / kBlend);
    const double body = low - kBlend * std::log(sum), hole = -hollow_.level(p);
    const double high = std::max(body, hole);
    return scale_ * (high + kBlend * std::log(std::exp((body - high) / kBlend) + std::exp((hole - high) / kBlend)));
}

}  // namespace teres::blindtest
