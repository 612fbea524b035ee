// Physical parameters (what the model takes) and filter coordinates (where the filter is Gaussian).
//
//     none      v = y                        absolute  v = |y|
//     project   v = clamp(y, lower, upper)   log       v = exp(y)      (then cut to [lower, upper])
//     sigmoid   v = lower + (upper - lower) / (1 + exp(-y))
//
// The prior is stated in physical units (median and either a log standard deviation or a standard deviation)
// and carried over so that the median is kept and the central 68 % interval is matched (README.md, "Prior").
// Bounds act on the way to the model only, never on the sigma points that the filter reads back: clamped
// points lose their spread, and a parameter without spread is frozen for good. bring_mean_inside() keeps the
// mean where the model still reacts. The other convention, needed to reproduce recorded peer runs, is
// read_back().
#pragma once

#include <Eigen/Dense>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace teres {

enum class Transform {
    kNone,
    kAbsolute,
    kProject,
    kSigmoid,
    kLog,
    /// The peer's sigmoid, kept to reproduce its runs: v = w/(1 + exp(-y/w)) - lower, w = upper - lower, and
    /// the stated standard deviation is that of y. v stays between the bounds when lower is 0 only.
    kScaledSigmoid,
};

/// none | absolute | project | sigmoid | log (also: exponential)
Result<Transform> parse_transform(std::string_view text);

struct ParameterSpec {
    std::string name = {};
    Transform transform = Transform::kLog;
    double median = 1.0;     ///< of the prior [unit of the parameter]
    double log_stdev = 0.0;  ///< > 0: the prior is log-normal with this standard deviation of ln v
    double stdev = 0.0;      ///< used when log_stdev is 0: standard deviation [unit of the parameter]
    double lower = -std::numeric_limits<double>::infinity();
    double upper = std::numeric_limits<double>::infinity();
    /// > 0: standard deviation in filter coordinates, stated directly (the peer's `exponential` takes
    /// ln(stdev)).
    double filter_stdev = 0.0;
};

class ParameterMap {
  public:
    /// Errors (kInvalidInput), with the parameter's name: a value that is not finite, lower >= upper, median
    /// outside the bounds, no spread, log of a median <= 0, sigmoid without finite bounds.
    static Result<ParameterMap> make(std::vector<ParameterSpec> specs);

    Eigen::Index size() const { return static_cast<Eigen::Index>(specs_.size()); }
    const ParameterSpec& spec(Eigen::Index i) const { return specs_[static_cast<std::size_t>(i)]; }
    const Eigen::VectorXd& prior_mean() const { return prior_mean_; }    ///< filter coordinates
    const Eigen::VectorXd& prior_stdev() const { return prior_stdev_; }  ///< filter coordinates
    Eigen::MatrixXd prior_covariance() const { return prior_stdev_.cwiseAbs2().asDiagonal(); }

    double to_physical(Eigen::Index i, double y) const;
    double to_filter(Eigen::Index i, double v) const;  ///< v outside the range of the transform is cut to it
    Eigen::MatrixXd to_physical(const Eigen::Ref<const Eigen::MatrixXd>& Y) const;  ///< column by column
    /// Standard deviation in physical units of the transformed Gaussian N(mean, stdev^2): exact where closed,
    /// else by quadrature.
    double physical_stdev(Eigen::Index i, double mean, double stdev) const;

    /// The peer's convention: the filter reads back |y| (absolute) or clamp(y) (project); log and sigmoid as
    /// they are.
    Eigen::MatrixXd read_back(const Eigen::Ref<const Eigen::MatrixXd>& Y) const;
    /// The step that brings a mean beyond its bounds back onto them (zero for the others).
    Eigen::VectorXd bring_mean_inside(const Eigen::Ref<const Eigen::VectorXd>& mean) const;

  private:
    std::vector<ParameterSpec> specs_;
    Eigen::VectorXd prior_mean_, prior_stdev_;
};

}  // namespace teres
