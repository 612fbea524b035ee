// teres calibrate-camera PICTURES: intrinsics and distortion from pictures of a checkerboard or of AprilTags.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "tools/calibration/camera_calibration.h"
#include "tools/film_commands.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

struct CalibrateOptions {
    std::vector<std::string> pictures, right;
    std::string board = "checkerboard", out, right_out, reference = "camera_left";
    Board shape;
    bool with_k3 = false;
    double max_rms_px = 1.0;
};

// The board in every picture, nothing where it is not found; all pictures of one size.
Result<std::vector<std::optional<BoardView>>> find_boards(const std::vector<std::string>& pictures, const Board& shape,
                                                          cv::Size& size, Progress& progress) {
    std::vector<std::optional<BoardView>> views;
    for (const std::string& file : pictures) {
        const cv::Mat grey = cv::imread(file, cv::IMREAD_GRAYSCALE);
        if (grey.empty()) return invalid_input(file + " is no picture that can be read");
        if (size.empty()) size = grey.size();
        if (grey.size() != size)
            return invalid_input(file + " is " + std::to_string(grey.cols) + "x" + std::to_string(grey.rows) + ", " +
                                 pictures[0] + " is " + std::to_string(size.width) + "x" + std::to_string(size.height));
        views.push_back(find_board(grey, shape));
        if (views.back())
            views.back()->file = file;
        else
            std::printf("%s: board not found\n", file.c_str());
        progress.step();
    }
    return views;
}

void print_camera(const CameraCalibration& found) {
    const CameraModel& c = found.camera;
    std::printf("  corners in %.0f %% of the image's fields, tilts up to %.0f degrees apart\n",
                100.0 * found.covered_share, found.tilt_deg);
    std::printf("  fx %.2f +- %.2f  fy %.2f +- %.2f  cx %.2f +- %.2f  cy %.2f +- %.2f px\n", c.fx_px, found.stdev_px[0],
                c.fy_px, found.stdev_px[1], c.cx_px, found.stdev_px[2], c.cy_px, found.stdev_px[3]);
    std::printf("  distortion k1 %.5f k2 %.5f p1 %.6f p2 %.6f k3 %.5f\n", c.distortion[0], c.distortion[1],
                c.distortion[2], c.distortion[3], c.distortion[4]);
}

Status check_error(const CameraCalibration& found, const std::vector<BoardView>& views, double max_rms_px) {
    const auto worst =
        std::max_element(views.begin(), views.end(), [](const auto& a, const auto& b) { return a.rms_px < b.rms_px; });
    std::printf("  reprojection error %.3f px rms; worst picture %s: %.3f px\n", found.rms_px, worst->file.c_str(),
                worst->rms_px);
    if (found.rms_px > max_rms_px)
        return not_usable("reprojection error " + std::to_string(found.rms_px) + " px is above " +
                          std::to_string(max_rms_px) + ": leave out " + worst->file +
                          ", or is the board bent, or not as described?");
    return {};
}

Result<int> calibrate_one(const CalibrateOptions& o) {
    cv::Size size;
    Progress progress("looking for the board", o.pictures.size());
    TERES_TRY_ASSIGN(const auto found_in, find_boards(o.pictures, o.shape, size, progress));
    std::vector<BoardView> views;
    for (const auto& view : found_in)
        if (view) views.push_back(*view);
    TERES_TRY_ASSIGN(const CameraCalibration found, calibrate(views, size.width, size.height, o.with_k3));
    std::printf("%zu of %zu pictures\n", views.size(), o.pictures.size());
    print_camera(found);
    TERES_TRY(check_error(found, views, o.max_rms_px));
    if (!o.out.empty()) TERES_TRY(write_calibration(o.out, found, views.size()));
    return kDone;
}

Result<int> calibrate_pair(const CalibrateOptions& o) {
    if (o.right.size() != o.pictures.size())
        return invalid_input(std::to_string(o.pictures.size()) + " pictures of the left camera, " +
                             std::to_string(o.right.size()) +
                             " of the right one: they must be pairs, in the same order");
    cv::Size size;
    Progress progress("looking for the board", 2 * o.pictures.size());
    TERES_TRY_ASSIGN(const auto in_left, find_boards(o.pictures, o.shape, size, progress));
    TERES_TRY_ASSIGN(const auto in_right, find_boards(o.right, o.shape, size, progress));
    std::vector<BoardView> left, right;
    for (std::size_t i = 0; i < in_left.size(); ++i)
        if (in_left[i] && in_right[i]) {
            left.push_back(*in_left[i]);
            right.push_back(*in_right[i]);
        }
    TERES_TRY_ASSIGN(const StereoCalibration found, calibrate_stereo(left, right, size.width, size.height, o.with_k3));
    std::printf("%zu of %zu pairs\nleft camera\n", left.size(), o.pictures.size());
    print_camera(found.left);
    TERES_TRY(check_error(found.left, left, o.max_rms_px));
    std::printf("right camera\n");
    print_camera(found.right);
    TERES_TRY(check_error(found.right, right, o.max_rms_px));
    const Point& t = found.right_to_left.t;
    std::printf("right camera in the left one's axes: %.5f %.5f %.5f m (baseline %.5f m), turned by %.3f degrees\n",
                t[0], t[1], t[2], found.baseline_m(), found.turn_deg());
    std::printf("  reprojection error of the pair %.3f px rms\n", found.rms_px);
    if (found.rms_px > o.max_rms_px)
        return not_usable("reprojection error of the pair " + std::to_string(found.rms_px) + " px is above " +
                          std::to_string(o.max_rms_px) + ": are the pictures pairs, taken at the same time?");
    if (!o.out.empty()) TERES_TRY(write_calibration(o.out, found.left, left.size()));
    if (!o.right_out.empty())
        TERES_TRY(write_calibration(o.right_out, found.right, right.size(),
                                    Mounting{found.right_to_left, o.reference, found.rms_px}));
    return kDone;
}

Result<int> calibrate_camera(CalibrateOptions o) {
    o.shape.kind = o.board == "apriltags" ? Board::Kind::kAprilTags : Board::Kind::kCheckerboard;
    return o.right.empty() ? calibrate_one(o) : calibrate_pair(o);
}

}  // namespace

void add_calibrate_camera_command(CLI::App& app, int& exit_code) {
    auto o = std::make_shared<CalibrateOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "calibrate-camera", "Intrinsics and distortion of a camera from pictures of a board",
        "  teres calibrate-camera shots/*.png --columns 9 --rows 6 --size 0.025 -o config/cameras/SERIAL.toml\n"
        "  teres calibrate-camera shots/*.png --board apriltags --columns 6 --rows 6 --size 0.03 --gap 0.009\n"
        "  teres calibrate-camera left/*.png --right right/*.png -o config/cameras/LEFT.toml --right-out "
        "config/cameras/RIGHT.toml\n"
        "10 to 20 pictures: the board close, in every part of the image, tilted by 30 to 45 degrees to all sides.",
        [o] {
            const Result<int> code = calibrate_camera(*o);
            return code ? *code : report(code.error());
        });
    verb->add_option("pictures", o->pictures, "Pictures of one camera, all of one size")
        ->required()
        ->type_name("FILE")
        ->check(CLI::ExistingFile);
    verb->add_option("--board", o->board, "Kind of board; tags are of family 36h11, numbered along the rows from 0")
        ->capture_default_str()
        ->check(CLI::IsMember({"checkerboard", "apriltags"}));
    verb->add_option("--columns", o->shape.columns, "Inner corners, or tags, along a row")
        ->capture_default_str()
        ->check(CLI::Range(2, 100));
    verb->add_option("--rows", o->shape.rows, "Rows of them")->capture_default_str()->check(CLI::Range(2, 100));
    verb->add_option("--size", o->shape.size_m, "Edge of a square or tag [m]")
        ->capture_default_str()
        ->check(CLI::Range(1e-4, 1.0));
    verb->add_option("--gap", o->shape.gap_m, "Between tags [m]")->capture_default_str()->check(CLI::Range(0.0, 1.0));
    verb->add_flag("--k3", o->with_k3, "Sixth-order distortion too: wide lenses, board also in the image's corners");
    verb->add_option("--max-rms", o->max_rms_px, "Refuse a larger reprojection error [px]")
        ->capture_default_str()
        ->check(CLI::Range(0.01, 100.0));
    CLI::Option* right =
        verb->add_option("--right", o->right, "Pictures of the right camera of a pair, in the order of the left one's")
            ->type_name("FILE")
            ->check(CLI::ExistingFile);
    verb->add_option("--right-out", o->right_out, "Settings file of the right camera, with its pose to the left one")
        ->type_name("FILE")
        ->needs(right);
    verb->add_option("--reference-frame", o->reference, "frame_id of the left camera's stream")
        ->capture_default_str()
        ->needs(right);
    verb->add_option("-o,--out", o->out, "Settings file to write, config/cameras/SERIAL.toml")->type_name("FILE");
}

}  // namespace teres::tools
