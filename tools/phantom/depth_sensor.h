// What an active stereo camera of D435 kind makes of true distances.
//
//     d = f B / z                 disparity [px]; noise of `disparity_sigma_px`, correlated over the matching window
//     σ_z = z² σ_d / (f B)        grows with the square of the distance
//
// Disparity comes in steps of 1/32 px, distance in steps of the depth unit. At edges the window straddles two
// surfaces: holes, and flying pixels between them. Nearer than f B / 126 nothing is matched.
#pragma once

#include <opencv2/core.hpp>

namespace teres::phantom {

struct DepthSensorOptions {
    double baseline_m = 0.050;
    double disparity_sigma_px = 0.08;
    double correlation_px = 1.0;
    double edge_jump_m = 0.008;
    double hole_share = 0.7;    ///< of edge pixels
    double flying_share = 0.2;  ///< of edge pixels
    double depth_unit_m = 1e-4;
};

class DepthSensor {
  public:
    DepthSensor(const DepthSensorOptions& options, double focal_px, std::uint64_t seed)
        : options_(options), f_b_(focal_px * options.baseline_m), random_(seed) {}
    /// `distance_m`: 32-bit float, 0 where nothing is. Gives counts of the depth unit, 16 bit, 0: no depth.
    cv::Mat measure(const cv::Mat& distance_m);
    /// σ_z at that distance [m]
    double sigma_m(double z_m) const { return z_m * z_m * options_.disparity_sigma_px / f_b_; }

  private:
    DepthSensorOptions options_;
    double f_b_;
    cv::RNG random_;
};

}  // namespace teres::phantom
