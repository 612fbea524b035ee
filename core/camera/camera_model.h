// Pinhole camera with Brown-Conrady distortion, and rigid poses. Pixel (0, 0) is the centre of the first pixel; camera
// axes: x right, y down, z forward [m].
//
//     x = X/Z, y = Y/Z, r² = x² + y²,  g = 1 + k1 r² + k2 r⁴ + k3 r⁶
//     x_d = g x + 2 p1 x y + p2 (r² + 2 x²)        y_d = g y + p1 (r² + 2 y²) + 2 p2 x y
//     u = fx x_d + cx,  v = fy y_d + cy             (Brown 1966; coefficients in OpenCV's order k1 k2 p1 p2 k3)
#pragma once

#include <array>
#include <optional>
#include <string>

#include "core/case/case.h"
#include "core/result.h"
#include "teres/camera_info_t.hpp"

namespace teres {

/// x_to = R x_from + t; R row-major.
struct Pose {
    std::array<double, 9> R{1, 0, 0, 0, 1, 0, 0, 0, 1};
    Point t{};
    Point apply(const Point& x) const;
    Point rotate(const Point& x) const;
    Pose inverse() const;
    Pose operator*(const Pose& first) const;  ///< this after `first`
};

/// Pose camera -> case of a camera that stands at `position`; nothing if a direction is missing or degenerate.
std::optional<Pose> camera_pose(const SensorData& sensor);

struct Pixel {
    double u = 0.0, v = 0.0;
};

struct CameraModel {
    int width_px = 0, height_px = 0;
    double fx_px = 0.0, fy_px = 0.0, cx_px = 0.0, cy_px = 0.0;
    std::array<double, 5> distortion{};

    /// [loop] Of a point in camera axes; nothing behind the camera or beyond the range of the distortion model.
    std::optional<Pixel> project(const Point& x) const;
    /// [loop] Direction with z = 1 that projects onto the pixel.
    Point ray(const Pixel& pixel) const;
    bool contains(const Pixel& pixel, double margin_px = 0.0) const {
        return pixel.u >= margin_px && pixel.v >= margin_px && pixel.u <= width_px - 1 - margin_px &&
               pixel.v <= height_px - 1 - margin_px;
    }
};

/// What a stream says of itself, checked.
struct StreamInfo {
    std::string serial, frame_id, reference_frame;
    CameraModel camera;
    Pose to_reference;          ///< x_reference = R x_camera + t
    double depth_unit_m = 0.0;  ///< 0: not a depth stream
    double baseline_m = 0.0;
};

/// Errors: a size or focal length that is not positive, a value that is not finite, R no rotation.
Result<StreamInfo> stream_info(const camera_info_t& message);
camera_info_t to_message(const StreamInfo& info);

}  // namespace teres
