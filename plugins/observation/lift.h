// From a pixel of the tracking camera to a point in its axes, with the covariance of what was measured.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "core/camera/camera_model.h"
#include "plugins/observation/blob_detector.h"

namespace teres {

struct LiftedPoint {
    Eigen::Vector3d x = Eigen::Vector3d::Zero();           ///< camera axes [m]
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m²]
};

struct LiftOptions {
    double pixel_sigma = 0.15;          ///< of a centre [px]
    double depth_noise_per_m = 4.2e-3;  ///< σ_z = this z² for a single depth pixel
    double window_radius_m = 0.003;     ///< of the patch whose depth is used
    double min_valid_share = 0.35;      ///< of the patch
    double max_spread_m = 0.004;        ///< left around the fitted plane: more is an edge
};

/// Covariance of a point at `ray` z: centre noise across, sigma_z along the ray.
Eigen::Matrix3d ray_covariance(const Eigen::Vector3d& ray, double z_m, double pixel_sigma, double focal_px,
                               double sigma_z_m);

class Lift {
  public:
    virtual ~Lift() = default;
    /// [loop] guess_z_m: about how far. Nothing where depth is missing or contradicts itself.
    virtual std::optional<LiftedPoint> at(const Blob& dot, double guess_z_m) const = 0;
};

/// Depth image of another camera; only the pixels around the wanted point are deprojected.
///
/// On a plane 1/z is linear in the pixel: 1/z = a + b du + c dv, fitted robustly (outliers beyond 3 scaled median
/// deviations are left out twice), so a tilted surface and one-sided holes do not bias the value at the centre.
class DepthLift final : public Lift {
  public:
    /// to_depth: tracking camera -> depth camera. `counts` must outlive the lift.
    DepthLift(const cv::Mat& counts, double depth_unit_m, const CameraModel& depth_camera,
              const CameraModel& tracking_camera, const Pose& to_depth, const LiftOptions& options)
        : counts_(counts),
          unit_m_(depth_unit_m),
          depth_(depth_camera),
          tracking_(tracking_camera),
          to_depth_(to_depth),
          options_(options) {}
    std::optional<LiftedPoint> at(const Blob& dot, double guess_z_m) const override;

  private:
    struct Depth {
        double z_m, sigma_m;
    };
    std::optional<Depth> depth_at(const Pixel& pixel, double guess_z_m) const;

    const cv::Mat& counts_;
    double unit_m_;
    CameraModel depth_, tracking_;
    Pose to_depth_;
    LiftOptions options_;
};

}  // namespace teres
