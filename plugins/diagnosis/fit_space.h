// Coordinates of a fit: ln of the nominal parameters, then each switched-on effect's parameters in their transform.
// Priors are independent Gaussians of these coordinates. A choice has been made before the fit: its prior is where it
// stands, and it does not move.
#pragma once

#include <Eigen/Dense>

#include "plugins/diagnosis/effect_table.h"

namespace teres {

/// The likelihood of a fit counts every number, though residuals are structured model error worth far fewer; beside it
/// the prior of the ligaments would count for nothing, and they would be bent to hide a cause. Theirs counts so many
/// times.
constexpr double kLigamentPriorWeight = 8.0;

class FitSpace {
  public:
    /// The effects of `pattern`, in its order; its values are the start.
    FitSpace(const TrajectoryModel& mechanics, const EffectTable& effects, const Assumption& pattern);

    Eigen::Index size() const { return mean_.size(); }
    Eigen::Index num_theta() const { return num_theta_; }
    const Eigen::VectorXd& prior_mean() const { return mean_; }
    const Eigen::VectorXd& prior_stdev() const { return stdev_; }
    Eigen::VectorXd coordinates(const Assumption& assumption) const;
    /// Clamped to the physical bounds, places of surface effects moved onto the surface.
    Assumption assumption(const Eigen::VectorXd& coordinates) const;
    /// The base moved by one finite-difference step along each coordinate; `step` gets the signed steps taken.
    std::vector<Assumption> neighbours(const Eigen::VectorXd& at, Eigen::VectorXd& step) const;
    /// Coordinate of effect `k` (in the pattern) and parameter `p`.
    Eigen::Index coordinate(std::size_t k, std::size_t p) const { return first_[k] + static_cast<Eigen::Index>(p); }

  private:
    struct Axis {
        bool log = false;
        double lower, upper;  // physical
        bool fixed = false;
    };
    std::vector<Axis> axes_;
    std::vector<Eigen::Index> first_;
    std::vector<std::size_t> entries_;
    const TrajectoryModel& mechanics_;
    const EffectTable& effects_;
    Eigen::Index num_theta_ = 0;
    Eigen::VectorXd mean_, stdev_;
};

}  // namespace teres
