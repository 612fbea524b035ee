// Where the camera stands to the preoperative model: first from landmarks, then refined on the depth surface.
//
//     landmarks   min Σ |x_i - (R p_i + t)|²                                 closed form (Arun et al. 1987)
//     surface     min Σ w_i ρ(n_i · (T p_i - q_i))²                          point to plane (Chen & Medioni 1991),
//     repeated:
//                 q_i, n_i: closest point of the model and its normal; T ← exp(ω, v) T about the centroid
//     dots        then also Σ |T d_j - m_j|²/σ²: each dot with the marker whose nearest dot it is, within a gate that
//     shrinks covariance  (Jᵀ W J)⁻¹ max(1, χ²/f), depth pixels that share one matching window counted once
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "core/camera/camera_model.h"
#include "core/case/case.h"
#include "core/result.h"

namespace teres {

struct RegistrationOptions {
    double start_gate_m = 0.02;         ///< farther points are not of the liver
    double least_gate_m = 0.004;        ///< the gate shrinks with the residuals, not below this
    double depth_noise_per_m = 4.2e-3;  ///< σ_z = this z² for a single depth pixel
    double model_sigma_m = 0.0005;      ///< of the model's surface
    int stride_px = 4;                  ///< every so many pixels both ways
    int max_iterations = 60;
    double max_rms_m =
        0.003;  ///< distance of the used points from the surface: more, and it is not at rest, or not this liver
    double max_stdev_m = 0.005, max_stdev_rad = 0.1;  ///< in the worst direction: more, and the surface leaves it open
};

struct Registration {
    Pose camera_to_case;
    Eigen::Vector3d centroid = Eigen::Vector3d::Zero();  ///< of the points used, case axes [m]
    Eigen::Matrix<double, 6, 6> covariance =
        Eigen::Matrix<double, 6, 6>::Zero();  ///< of (ω [rad], v [m]): case axes, about the centroid
    double rms_m = 0.0;                       ///< distance of the points used from the surface
    std::size_t points = 0, markers = 0;      ///< used
    int iterations = 0;
};

/// camera: points in camera axes, model: the same ones in case axes. Errors: fewer than three, or on one line.
Result<Pose> align_landmarks(std::span<const Point> camera, std::span<const Point> model);

/// Points of a depth image in camera axes, every stride_px pixels; holes are left out.
std::vector<Point> depth_points(std::span<const std::uint16_t> counts, const CameraModel& camera, double depth_unit_m,
                                int stride_px);

/// A dot that may be a marker, camera axes [m].
struct SeenDot {
    Point x;
    double sigma_m;
};
/// Dots against markers at rest (case axes), which is which unknown.
struct DotsAndMarkers {
    std::span<const SeenDot> dots;
    std::span<const Point> markers;
};

/// points: camera axes. Errors (kNotUsable): too few points near the surface and fewer than four dots near markers,
/// their places leave a direction open, or they stay too far from the surface.
Result<Registration> refine_on_surface(const TetMeshData& model, std::span<const Point> points, const Pose& start,
                                       const RegistrationOptions& options, const DotsAndMarkers& marks = {});

/// Covariance of a point at rest in the camera, that the pose's leaves in case axes [m²].
Eigen::Matrix3d covariance_at(const Registration& registration, const Eigen::Vector3d& x_case);

}  // namespace teres
