#include "tools/blindtest/band.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace teres::blindtest {
namespace {
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kCore = 0.004, kSpread = 0.009;  // [m] certain half width, then a bell
constexpr double kEndFade = 7.0;                  // [deg]
constexpr double kPeak = 0.97;
}  // namespace

double Band::theta_deg(const Point& p) const {
    return std::atan2(p[1] - axis_m[1], p[2] - axis_m[2]) / kDegree;
}

double Band::across_m(const Point& p) const {
    const double along = (theta_deg(p) - 0.5 * (theta0_deg + theta1_deg)) / (theta1_deg - theta0_deg);
    return p[0] - x0_m - tilt_m * along;
}

bool Band::contains(const Point& p) const {
    const double theta = theta_deg(p);
    return std::abs(across_m(p)) <= 0.5 * width_m && theta >= theta0_deg && theta <= theta1_deg;
}

double Band::prior_probability(const Point& p) const {
    const double theta = theta_deg(p), away = std::max(std::abs(across_m(p)) - kCore, 0.0) / kSpread;
    return kPeak * std::exp(-0.5 * away * away) / (1.0 + std::exp((theta0_deg - theta) / kEndFade)) /
           (1.0 + std::exp((theta - theta1_deg) / kEndFade));
}

Point Band::middle_direction() const {
    const double theta = 0.5 * (theta0_deg + theta1_deg) * kDegree;
    return {0.0, std::sin(theta), std::cos(theta)};
}

}  // namespace teres::blindtest
