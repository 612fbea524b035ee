// Intrinsics and distortion of a camera from pictures of a flat board (Zhang 2000, by OpenCV).
//
//     minimise Σ |pixel - project(camera, R_i, t_i, corner)|² over the camera and the board's pose in every picture i
//     a pair: each camera by itself, then the same over both cameras' pixels for the pose between them
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/camera/camera_model.h"
#include "core/result.h"

namespace teres::tools {

struct Board {
    enum class Kind { kCheckerboard, kAprilTags };  // tags of family 36h11, numbered along the rows from 0
    Kind kind = Kind::kCheckerboard;
    int columns = 9, rows = 6;  ///< inner corners of a checkerboard, or tags
    double size_m = 0.025;      ///< edge of a square or of a tag
    double gap_m = 0.0;         ///< between tags
};

struct BoardView {
    std::string file;
    std::vector<cv::Point2f> pixels;
    std::vector<cv::Point3f> corners_m;  ///< the same corners on the board
    double rms_px = 0.0;                 ///< reprojection, after calibrate()
};

struct CameraCalibration {
    CameraModel camera;
    double rms_px = 0.0;               ///< reprojection error over all corners
    std::array<double, 4> stdev_px{};  ///< of fx, fy, cx, cy
    double covered_share = 0.0;        ///< of 8 x 6 fields of the image that hold a corner
    double tilt_deg = 0.0;             ///< largest angle between the board's planes in two views
};

/// Board in an 8-bit grey picture, corners to a fraction of a pixel; nothing if it is not found whole (checkerboard) or
/// if fewer than four of its tags are seen.
std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board);

/// with_k3: sixth-order distortion too (needs corners near the image's corners). Sets rms_px of the views.
/// Errors: kNotUsable with fewer than four views, or if the views leave the focal length open.
Result<CameraCalibration> calibrate(std::span<BoardView> views, int width_px, int height_px, bool with_k3 = false);

struct StereoCalibration {
    CameraCalibration left, right;
    Pose right_to_left;
    double rms_px = 0.0;  ///< reprojection error over both cameras, with one pose between them
    double baseline_m() const;
    double turn_deg() const;
};

/// left[i], right[i]: the same board at the same time, from cameras of one picture size; only corners that both see
/// count for the pose between them. Errors: kNotUsable as for one camera, or fewer than four pairs.
Result<StereoCalibration> calibrate_stereo(std::span<BoardView> left, std::span<BoardView> right, int width_px,
                                           int height_px, bool with_k3 = false);

/// What a second camera's file says besides: where it stands to the first.
struct Mounting {
    Pose to_reference;
    std::string reference_frame;
    double rms_px = 0.0;
};

/// config/cameras/SERIAL.toml as the camera driver reads it.
Status write_calibration(const std::string& file, const CameraCalibration& calibration, std::size_t num_views,
                         const std::optional<Mounting>& mounting = {});

}  // namespace teres::tools
