#include "plugins/estimator/parameter_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plugins/estimator/probability.h"

namespace teres {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// exp() of anything beyond is no stiffness; keeps the model free of infinities.
constexpr double kMaxLog = 300.0;
// A sigmoid never reaches its bounds: a value on one stands for this share of the interval.
constexpr double kSigmoidEdge = 1e-4;

bool has_finite_bounds(const ParameterSpec& spec) {
    return std::isfinite(spec.lower) && std::isfinite(spec.upper);
}

// sigma of ln v of the log-normal with this median and standard deviation: u (u - 1) = (s/m)^2, u =
// exp(sigma^2).
double log_stdev_of(double median, double stdev) {
    const double ratio = stdev / median;
    return std::sqrt(std::log(0.5 * (1.0 + std::sqrt(1.0 + 4.0 * ratio * ratio))));
}

// Standard deviation of the log-normal with this median.
double stdev_of_log(double median, double log_stdev) {
    const double u = std::exp(std::min(log_stdev * log_stdev, kMaxLog));
    return median * std::sqrt(u * (u - 1.0));
}

Status check(const ParameterSpec& s) {
    const auto fail = [&](const std::string& what) {
        return invalid_input(fmt::format("parameter {}: {}", s.name, what));
    };
    if (!std::isfinite(s.median)) return fail(fmt::format("prior median {} is not finite", s.median));
    if (!std::isfinite(s.log_stdev) || s.log_stdev < 0.0)
        return fail(fmt::format("prior log standard deviation {} must be finite and >= 0", s.log_stdev));
    if (!std::isfinite(s.stdev) || s.stdev < 0.0)
        return fail(fmt::format("prior standard deviation {} must be finite and >= 0", s.stdev));
    if (s.log_stdev == 0.0 && s.stdev == 0.0 && !(s.filter_stdev > 0.0))
        return fail("the prior has no spread: state a standard deviation > 0");
    if (std::isnan(s.lower) || std::isnan(s.upper) || !(s.lower < s.upper))
        return fail(fmt::format("bounds [{}, {}] are empty", s.lower, s.upper));
    if (s.median < s.lower || s.median > s.upper)
        return fail(fmt::format("prior median {} is outside its bounds [{}, {}]", s.median, s.lower, s.upper));
    if ((s.transform == Transform::kLog || s.log_stdev > 0.0) && !(s.median > 0.0))
        return fail(fmt::format("prior median {} must be > 0 for a log-normal prior or the transform log", s.median));
    if ((s.transform == Transform::kSigmoid || s.transform == Transform::kScaledSigmoid) && !has_finite_bounds(s))
        return fail(fmt::format("transform sigmoid needs finite bounds, not [{}, {}]", s.lower, s.upper));
    return {};
}

double filter_stdev_of(const ParameterMap& map, Index i) {
    const ParameterSpec& s = map.spec(i);
    if (s.filter_stdev > 0.0) return s.filter_stdev;
    switch (s.transform) {
        case Transform::kLog:
            return s.log_stdev > 0.0 ? s.log_stdev : log_stdev_of(s.median, s.stdev);
        case Transform::kSigmoid: {
            // Half of the distance of the 16 % and 84 % quantiles, which a monotone transform carries over
            // exactly.
            const double low = s.log_stdev > 0.0 ? s.median * std::exp(-s.log_stdev) : s.median - s.stdev;
            const double high = s.log_stdev > 0.0 ? s.median * std::exp(s.log_stdev) : s.median + s.stdev;
            return 0.5 * (map.to_filter(i, high) - map.to_filter(i, low));
        }
        default:
            return s.log_stdev > 0.0 ? stdev_of_log(s.median, s.log_stdev) : s.stdev;
    }
}

}  // namespace

Result<Transform> parse_transform(std::string_view text) {
    if (text == "none") return Transform::kNone;
    if (text == "absolute") return Transform::kAbsolute;
    if (text == "project") return Transform::kProject;
    if (text == "sigmoid") return Transform::kSigmoid;
    if (text == "log" || text == "exponential") return Transform::kLog;
    return invalid_input(fmt::format("transform '{}' is not one of none|absolute|project|sigmoid|log", text));
}

Result<ParameterMap> ParameterMap::make(std::vector<ParameterSpec> specs) {
    if (specs.empty()) return invalid_input("the model has no parameters to estimate");
    ParameterMap map;
    map.specs_ = std::move(specs);
    map.prior_mean_.resize(map.size());
    map.prior_stdev_.resize(map.size());
    for (Index i = 0; i < map.size(); ++i) {
        TERES_TRY(check(map.spec(i)));
        map.prior_mean_(i) = map.to_filter(i, map.spec(i).median);
        map.prior_stdev_(i) = filter_stdev_of(map, i);
    }
    return map;
}

double ParameterMap::to_physical(Index i, double y) const {
    const ParameterSpec& s = spec(i);
    switch (s.transform) {
        case Transform::kNone:
            return y;
        case Transform::kAbsolute:
            return std::abs(y);
        case Transform::kProject:
            return std::clamp(y, s.lower, s.upper);
        case Transform::kSigmoid:
            return s.lower + (s.upper - s.lower) / (1.0 + std::exp(-y));
        case Transform::kScaledSigmoid: {
            const double width = s.upper - s.lower;
            return width / (1.0 + std::exp(-y / width)) - s.lower;
        }
        case Transform::kLog:
            return std::clamp(std::exp(std::clamp(y, -kMaxLog, kMaxLog)), s.lower, s.upper);
    }
    return y;
}

double ParameterMap::to_filter(Index i, double v) const {
    const ParameterSpec& s = spec(i);
    switch (s.transform) {
        case Transform::kNone:
        case Transform::kAbsolute:
            return v;
        case Transform::kProject:
            return std::clamp(v, s.lower, s.upper);
        case Transform::kSigmoid: {
            const double share = std::clamp((v - s.lower) / (s.upper - s.lower), kSigmoidEdge, 1.0 - kSigmoidEdge);
            return std::log(share / (1.0 - share));
        }
        case Transform::kScaledSigmoid: {
            const double width = s.upper - s.lower;
            const double share = std::clamp((v + s.lower) / width, kSigmoidEdge, 1.0 - kSigmoidEdge);
            return width * std::log(share / (1.0 - share));
        }
        case Transform::kLog:
            return v > 0.0 ? std::clamp(std::log(v), -kMaxLog, kMaxLog) : -kMaxLog;
    }
    return v;
}

MatrixXd ParameterMap::to_physical(const Eigen::Ref<const MatrixXd>& Y) const {
    MatrixXd V(Y.rows(), Y.cols());
    for (Index j = 0; j < Y.cols(); ++j)
        for (Index i = 0; i < Y.rows(); ++i) V(i, j) = to_physical(i, Y(i, j));
    return V;
}

double ParameterMap::physical_stdev(Index i, double mean, double stdev) const {
    switch (spec(i).transform) {
        case Transform::kNone:
        case Transform::kAbsolute:
        case Transform::kProject:
            return stdev;
        case Transform::kLog:
            return stdev_of_log(to_physical(i, mean), stdev);
        case Transform::kSigmoid:
        case Transform::kScaledSigmoid:
            break;
    }
    // Midpoint rule over equally probable slices of the Gaussian.
    constexpr int kSlices = 64;
    double sum = 0.0, squares = 0.0;
    for (int k = 0; k < kSlices; ++k) {
        const double v = to_physical(i, mean + stdev * probit((k + 0.5) / kSlices)) - to_physical(i, mean);
        sum += v;
        squares += v * v;
    }
    sum /= kSlices;
    return std::sqrt(std::max(0.0, squares / kSlices - sum * sum));
}

MatrixXd ParameterMap::read_back(const Eigen::Ref<const MatrixXd>& Y) const {
    MatrixXd result = Y;
    for (Index i = 0; i < Y.rows(); ++i) {
        const Transform transform = spec(i).transform;
        if (transform != Transform::kAbsolute && transform != Transform::kProject) continue;
        for (Index j = 0; j < Y.cols(); ++j) result(i, j) = to_physical(i, Y(i, j));
    }
    return result;
}

VectorXd ParameterMap::bring_mean_inside(const Eigen::Ref<const VectorXd>& mean) const {
    VectorXd delta = VectorXd::Zero(mean.size());
    for (Index i = 0; i < mean.size(); ++i) {
        const ParameterSpec& s = spec(i);
        if (s.transform == Transform::kNone || s.transform == Transform::kAbsolute ||
            s.transform == Transform::kScaledSigmoid)
            continue;
        if (std::isfinite(s.lower)) delta(i) = std::max(delta(i), to_filter(i, s.lower) - mean(i));
        if (std::isfinite(s.upper)) delta(i) = std::min(delta(i), to_filter(i, s.upper) - mean(i));
    }
    return delta;
}

}  // namespace teres
