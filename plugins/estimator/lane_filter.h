// One face for both filters around a batch of simulations ("lanes", one per sigma point).
//
// reduced-order  state and parameters are filtered together: each lane starts where the filter expects it,
// which for a
//                quasi-static model is a start value good to second order, and the correction moves the state
//                too.
// parameters     lanes start from one common state; the caller advances it once more with the corrected
// parameters.
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <span>

#include "plugins/estimator/ensemble_correction.h"
#include "plugins/estimator/sigma_points.h"

namespace teres {

class LaneFilter {
  public:
    virtual ~LaneFilter() = default;

    virtual Eigen::Index num_lanes() const = 0;
    /// P <- D P D + Q for the parameters, D and Q diagonal.
    virtual void widen(const Eigen::VectorXd& factor, const Eigen::VectorXd& noise_variance) = 0;
    virtual void shift_parameters(const Eigen::VectorXd& delta) = 0;
    /// The model no longer reacts to parameter i: it is N(mean, stdev^2), apart from all else.
    virtual void release_parameter(Eigen::Index i, double mean, double stdev) = 0;
    /// lanes: num_state x r start values; theta: p x r in filter coordinates.
    virtual void draw(double spread, Eigen::MatrixXd& lanes, Eigen::MatrixXd& theta) = 0;
    /// lanes after the model; theta as drawn.
    virtual void predict(const Eigen::MatrixXd& lanes) = 0;
    virtual Innovation innovation(const Eigen::VectorXd& z, const Eigen::MatrixXd& Z) const = 0;
    virtual Correction correct(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                               std::span<const std::uint8_t> used) = 0;
    /// The state must be advanced once more with the corrected parameters, and handed in by set_state().
    virtual bool needs_mean_step() const = 0;
    virtual void set_state(const Eigen::VectorXd& x) = 0;

    virtual Eigen::Ref<const Eigen::VectorXd> state() const = 0;
    virtual Eigen::VectorXd theta() const = 0;
    virtual Eigen::MatrixXd covariance() const = 0;  ///< of the parameters
};

/// prior covariance diagonal, filter coordinates.
std::unique_ptr<LaneFilter> make_reduced_order_lane_filter(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                           const Eigen::VectorXd& stdev, SigmaPointKind points);
std::unique_ptr<LaneFilter> make_parameter_lane_filter(const Eigen::VectorXd& x, const Eigen::VectorXd& theta,
                                                       const Eigen::VectorXd& stdev, SigmaPointKind points);

}  // namespace teres
