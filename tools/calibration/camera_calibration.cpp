#include "tools/calibration/camera_calibration.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <set>

namespace teres::tools {
namespace {

constexpr std::size_t kMinViews = 4, kMinTags = 4;
constexpr int kFieldsAcross = 8, kFieldsDown = 6;
constexpr double kMaxFocalStdev = 0.02;  // of the focal length: more, and the views leave it open
constexpr double kMinTilt_deg = 15.0;    // between two views: less, and focal length and distance are one

std::optional<BoardView> find_checkerboard(const cv::Mat& grey, const Board& board) {
    BoardView view;
    // Not CALIB_CB_NORMALIZE_IMAGE nor _ACCURACY: with OpenCV 4.6 corners then scatter by 0.3 px instead of 0.07 px.
    if (!cv::findChessboardCornersSB(grey, {board.columns, board.rows}, view.pixels, cv::CALIB_CB_EXHAUSTIVE))
        return std::nullopt;
    for (int row = 0; row < board.rows; ++row)
        for (int column = 0; column < board.columns; ++column)
            view.corners_m.emplace_back(static_cast<float>(column * board.size_m),
                                        static_cast<float>(row * board.size_m), 0.0F);
    return view;
}

std::optional<BoardView> find_tags(const cv::Mat& grey, const Board& board) {
    const auto family = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
    const auto grid = cv::aruco::GridBoard::create(board.columns, board.rows, static_cast<float>(board.size_m),
                                                   static_cast<float>(board.gap_m), family);
    const auto how = cv::aruco::DetectorParameters::create();
    how->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(grey, family, corners, ids, how);
    BoardView view;
    cv::aruco::getBoardObjectAndImagePoints(grid, corners, ids, view.corners_m, view.pixels);
    if (view.pixels.size() < 4 * kMinTags) return std::nullopt;
    return view;
}

double covered_share(std::span<const BoardView> views, int width_px, int height_px) {
    std::set<std::pair<int, int>> fields;
    for (const BoardView& view : views)
        for (const cv::Point2f& p : view.pixels)
            fields.emplace(static_cast<int>(p.x * kFieldsAcross / static_cast<float>(width_px)),
                           static_cast<int>(p.y * kFieldsDown / static_cast<float>(height_px)));
    return static_cast<double>(fields.size()) / (kFieldsAcross * kFieldsDown);
}

double largest_tilt_deg(const std::vector<cv::Mat>& rotations) {
    std::vector<cv::Vec3d> normals;
    for (const cv::Mat& r : rotations) {
        cv::Matx33d R;
        cv::Rodrigues(r, R);
        normals.emplace_back(R(0, 2), R(1, 2), R(2, 2));
    }
    double least = 1.0;
    for (const cv::Vec3d& a : normals)
        for (const cv::Vec3d& b : normals) least = std::min(least, std::abs(a.dot(b)));
    return std::acos(least) * 180.0 / std::numbers::pi;
}

}  // namespace

std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board) {
    return board.kind == Board::Kind::kCheckerboard ? find_checkerboard(grey, board) : find_tags(grey, board);
}

Result<CameraCalibration> calibrate(std::span<BoardView> views, int width_px, int height_px, bool with_k3) {
    if (views.size() < kMinViews)
        return not_usable(fmt::format("board found in {} pictures, at least {} are needed", views.size(), kMinViews));
    std::vector<std::vector<cv::Point3f>> corners;
    std::vector<std::vector<cv::Point2f>> pixels;
    for (const BoardView& view : views) {
        corners.push_back(view.corners_m);
        pixels.push_back(view.pixels);
    }
    cv::Mat K, distortion, stdev, stdev_poses, per_view;
    std::vector<cv::Mat> rotations, translations;
    CameraCalibration result;
    result.rms_px = cv::calibrateCamera(corners, pixels, {width_px, height_px}, K, distortion, rotations, translations,
                                        stdev, stdev_poses, per_view, with_k3 ? 0 : cv::CALIB_FIX_K3);
    result.camera = {width_px,           height_px, K.at<double>(0, 0), K.at<double>(1, 1), K.at<double>(0, 2),
                     K.at<double>(1, 2), {}};
    for (int i = 0; i < 5; ++i) result.camera.distortion[static_cast<std::size_t>(i)] = distortion.at<double>(i);
    for (int i = 0; i < 4; ++i) result.stdev_px[static_cast<std::size_t>(i)] = stdev.at<double>(i);
    for (std::size_t i = 0; i < views.size(); ++i) views[i].rms_px = per_view.at<double>(static_cast<int>(i));
    result.covered_share = covered_share(views, width_px, height_px);
    result.tilt_deg = largest_tilt_deg(rotations);
    const double f = result.camera.fx_px;
    if (!(f > 0.0) || !std::isfinite(result.rms_px) || !(result.stdev_px[0] < kMaxFocalStdev * f) ||
        result.tilt_deg < kMinTilt_deg)
        return not_usable(fmt::format(
            "the views leave the focal length open ({:.0f} +- {:.0f} px, at most 2 % are allowed; largest tilt between "
            "two views {:.0f} degrees, at least {:.0f} are needed): hold the board at 30 to 45 degrees, to several "
            "sides",
            f, result.stdev_px[0], result.tilt_deg, kMinTilt_deg));
    return result;
}

double StereoCalibration::baseline_m() const {
    return std::hypot(right_to_left.t[0], right_to_left.t[1], right_to_left.t[2]);
}

double StereoCalibration::turn_deg() const {
    const auto& R = right_to_left.R;
    return std::acos(std::clamp(0.5 * (R[0] + R[4] + R[8] - 1.0), -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

Result<StereoCalibration> calibrate_stereo(std::span<BoardView> left, std::span<BoardView> right, int width_px,
                                           int height_px, bool with_k3) {
    StereoCalibration result;
    TERES_TRY_ASSIGN(result.left, calibrate(left, width_px, height_px, with_k3));
    TERES_TRY_ASSIGN(result.right, calibrate(right, width_px, height_px, with_k3));
    std::vector<std::vector<cv::Point3f>> corners;
    std::vector<std::vector<cv::Point2f>> left_pixels, right_pixels;
    for (std::size_t i = 0; i < std::min(left.size(), right.size()); ++i) {
        std::vector<cv::Point3f> common;
        std::vector<cv::Point2f> in_left, in_right;
        for (std::size_t k = 0; k < left[i].corners_m.size(); ++k) {
            const auto same = std::ranges::find(right[i].corners_m, left[i].corners_m[k]);
            if (same == right[i].corners_m.end()) continue;
            common.push_back(*same);
            in_left.push_back(left[i].pixels[k]);
            in_right.push_back(right[i].pixels[static_cast<std::size_t>(same - right[i].corners_m.begin())]);
        }
        if (common.size() < kMinTags) continue;
        corners.push_back(std::move(common));
        left_pixels.push_back(std::move(in_left));
        right_pixels.push_back(std::move(in_right));
    }
    if (corners.size() < kMinViews)
        return not_usable(
            fmt::format("board found by both cameras in {} pairs, at least {} are needed", corners.size(), kMinViews));
    const auto matrix = [](const CameraModel& c) {
        return cv::Mat(cv::Matx33d(c.fx_px, 0.0, c.cx_px, 0.0, c.fy_px, c.cy_px, 0.0, 0.0, 1.0));
    };
    const auto distortion = [](const CameraModel& c) { return cv::Mat(c.distortion, true); };
    cv::Mat K1 = matrix(result.left.camera), D1 = distortion(result.left.camera), K2 = matrix(result.right.camera),
            D2 = distortion(result.right.camera);
    cv::Mat R, t, E, F;  // x_right = R x_left + t
    result.rms_px = cv::stereoCalibrate(corners, left_pixels, right_pixels, K1, D1, K2, D2, {width_px, height_px}, R, t,
                                        E, F, cv::CALIB_FIX_INTRINSIC);
    Pose left_to_right;
    for (int i = 0; i < 9; ++i) left_to_right.R[static_cast<std::size_t>(i)] = R.at<double>(i / 3, i % 3);
    for (int i = 0; i < 3; ++i) left_to_right.t[static_cast<std::size_t>(i)] = t.at<double>(i);
    result.right_to_left = left_to_right.inverse();
    return result;
}

Status write_calibration(const std::string& file, const CameraCalibration& calibration, std::size_t num_views,
                         const std::optional<Mounting>& mounting) {
    const CameraModel& c = calibration.camera;
    std::ofstream out(file);
    out << fmt::format(
        "# teres calibrate-camera: {} views, reprojection error {:.3f} px rms, board in {:.0f} % of the image's "
        "fields\n"
        "width_px = {}\nheight_px = {}\nfx_px = {:.4f}    # +- {:.3f}\nfy_px = {:.4f}    # +- {:.3f}\ncx_px = {:.4f}   "
        " # +- {:.3f}\n"
        "cy_px = {:.4f}    # +- {:.3f}\ndistortion = [{:.8f}, {:.8f}, {:.8f}, {:.8f}, {:.8f}]    # k1 k2 p1 p2 k3\n",
        num_views, calibration.rms_px, 100.0 * calibration.covered_share, c.width_px, c.height_px, c.fx_px,
        calibration.stdev_px[0], c.fy_px, calibration.stdev_px[1], c.cx_px, calibration.stdev_px[2], c.cy_px,
        calibration.stdev_px[3], c.distortion[0], c.distortion[1], c.distortion[2], c.distortion[3], c.distortion[4]);
    if (mounting) {
        const auto& [R, t] = mounting->to_reference;
        out << fmt::format(
            "reference_frame = \"{}\"    # x_reference = R x + t; pair: {:.3f} px rms\nrotation = "
            "[{:.9f}]\ntranslation_m = [{:.7f}]\nbaseline_m = {:.7f}\n",
            mounting->reference_frame, mounting->rms_px, fmt::join(R, ", "), fmt::join(t, ", "),
            std::hypot(t[0], t[1], t[2]));
    }
    out.close();
    return out ? Status() : Status(host_fault("cannot write " + file));
}

}  // namespace teres::tools
