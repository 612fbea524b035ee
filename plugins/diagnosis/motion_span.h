// What of a residual the error of our own model cannot be. Without inertia that error follows from where the loads
// stand, so that in time it is made of what the motion under these loads is made of:
//
//     e(t) = E b(t),   b(t): a constant and the leading temporal modes of the nominal motion
//
// A heartbeat, a breath, a jump, a drift has a course of its own; what of it lies beside span b is noise or an effect.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

class MotionSpan {
  public:
    /// `motion`: 3 M F rows, finite [m]; `rows`: the used entries of it, ascending.
    MotionSpan(const Eigen::VectorXd& motion, std::size_t channels, const std::vector<Eigen::Index>& rows);

    /// |r - projection|^2 of whitened residuals, one per used row: each channel on its own, over its used frames.
    double beside(const Eigen::VectorXd& residual) const;
    /// Of so many used rows: expected of unit white noise.
    double degrees() const { return degrees_; }

  private:
    struct Channel {
        std::vector<Eigen::Index> at;  // in the list of used rows
        Eigen::MatrixXd basis;         // orthonormal, over these
    };
    std::vector<Channel> channels_;
    double degrees_ = 0.0;
};

}  // namespace teres
