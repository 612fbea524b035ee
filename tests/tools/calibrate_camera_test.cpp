// Boards rendered through a known camera: the calibration must find it again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/aruco.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "drivers/camera/calibration_file.h"
#include "tests/support/program.h"
#include "tools/calibration/camera_calibration.h"

namespace teres::tools {
namespace {

using Eigen::Vector3d;

const CameraModel kTruth{640, 480, 612.0, 609.0, 325.5, 236.0, {0.09, -0.21, 8e-4, -6e-4, 0.0}};
const Board kChecker{Board::Kind::kCheckerboard, 9, 6, 0.02, 0.0};
const Board kTags{Board::Kind::kAprilTags, 4, 3, 0.036, 0.009};

// Reflectance of the board's plane, 0 or 1, at x, y [m].
class Pattern {
  public:
    explicit Pattern(const Board& board) : board_(board) {
        if (board.kind == Board::Kind::kCheckerboard) return;
        const auto family = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
        for (int id = 0; id < board.columns * board.rows; ++id)
            cv::aruco::drawMarker(family, id, 80, tags_.emplace_back());
    }
    Vector3d middle() const {
        const double step = board_.size_m + board_.gap_m, last = board_.kind == Board::Kind::kCheckerboard ? -1.0 : 0.0;
        return {0.5 * step * (board_.columns + last), 0.5 * step * (board_.rows + last), 0.0};
    }
    double at(double x, double y) const {
        if (board_.kind == Board::Kind::kCheckerboard) {
            const int i = static_cast<int>(std::floor(x / board_.size_m)) + 1,
                      j = static_cast<int>(std::floor(y / board_.size_m)) + 1;
            return i < 0 || j < 0 || i > board_.columns || j > board_.rows ? 1.0 : (i + j) % 2;
        }
        // Tags are laid out as in OpenCV's GridBoard: y from the first row's top edge.
        const double step = board_.size_m + board_.gap_m;
        const int i = static_cast<int>(std::floor(x / step)), j = static_cast<int>(std::floor(y / step));
        const double fx = x - i * step, fy = y - j * step;
        if (i < 0 || j < 0 || i >= board_.columns || j >= board_.rows || fx > board_.size_m || fy > board_.size_m)
            return 1.0;
        const cv::Mat& tag = tags_[static_cast<std::size_t>(j * board_.columns + i)];
        const double px = fx / board_.size_m * tag.cols, py = fy / board_.size_m * tag.rows;
        return tag.at<std::uint8_t>(std::min(tag.rows - 1, static_cast<int>(py)),
                                    std::min(tag.cols - 1, static_cast<int>(px))) /
               255.0;
    }

  private:
    Board board_;
    std::vector<cv::Mat> tags_;
};

// Rays through the corners of the pixels.
const std::vector<Vector3d>& rays() {
    static const std::vector<Vector3d> all = [] {
        std::vector<Vector3d> list;
        for (int v = 0; v <= kTruth.height_px; ++v)
            for (int u = 0; u <= kTruth.width_px; ++u) {
                const Point r = kTruth.ray({u - 0.5, v - 0.5});
                list.emplace_back(r[0], r[1], r[2]);
            }
        return list;
    }();
    return all;
}

// The second camera of a pair: x_left = R x_right + t.
const Eigen::Matrix3d kTurn = Eigen::AngleAxisd(0.06, Vector3d(0.2, -1.0, 0.1).normalized()).toRotationMatrix();
const Vector3d kShift(0.048, 0.0015, -0.002);

// View number k: turned to another side by 25 to 40 degrees, 0.30 to 0.38 m away, off the axis; 4 x 4 rays a pixel.
cv::Mat shot(const Board& board, int k, bool right = false) {
    const Pattern pattern(board);
    const double side = 2.4 * k, tilt = k == 0 ? 0.05 : 0.44 + 0.06 * (k % 5);
    Eigen::Matrix3d R = Eigen::AngleAxisd(tilt, Vector3d(std::cos(side), std::sin(side), 0.0)).toRotationMatrix();
    Vector3d t =
        Vector3d(0.05 * std::cos(1.3 * k), 0.04 * std::sin(1.7 * k), 0.30 + 0.016 * (k % 6)) - R * pattern.middle();
    if (right) {
        R = kTurn.transpose() * R;
        t = kTurn.transpose() * (t - kShift);
    }
    const Eigen::Matrix3d to_board = R.transpose();
    const Vector3d n = to_board.row(2), origin = to_board * t;
    const double distance = n.dot(t);
    constexpr int kRays = 4;
    cv::Mat image(kTruth.height_px, kTruth.width_px, CV_8U);
    cv::RNG noise(static_cast<std::uint64_t>(k) + (right ? 100 : 1));
    for (int v = 0; v < image.rows; ++v)
        for (int u = 0; u < image.cols; ++u) {
            double sum = 0.0;
            const Vector3d* corner = &rays()[static_cast<std::size_t>(v * (kTruth.width_px + 1) + u)];
            const Vector3d across = corner[1] - corner[0], down = corner[kTruth.width_px + 1] - corner[0];
            for (int i = 0; i < kRays; ++i)
                for (int j = 0; j < kRays; ++j) {
                    const Vector3d ray = corner[0] + (i + 0.5) / kRays * across + (j + 0.5) / kRays * down;
                    const Vector3d x = to_board * ray * (distance / n.dot(ray)) - origin;
                    sum += pattern.at(x.x(), x.y());
                }
            image.at<std::uint8_t>(v, u) =
                cv::saturate_cast<std::uint8_t>(40.0 + 170.0 * sum / (kRays * kRays) + noise.gaussian(2.0));
        }
    return image;
}

// Largest distance between where both cameras see the same ray; the boards reach to about 40 px from the image's
// border.
double largest_difference_px(const CameraModel& found) {
    double worst = 0.0;
    for (int v = 40; v < kTruth.height_px - 40; v += 20)
        for (int u = 40; u < kTruth.width_px - 40; u += 20) {
            const auto p = found.project(kTruth.ray({double(u), double(v)}));
            worst = std::max(worst, p ? std::hypot(p->u - u, p->v - v) : 1e3);
        }
    return worst;
}

class CalibrateCamera : public ::testing::TestWithParam<Board> {};

TEST_P(CalibrateCamera, FindsTheCameraThatTookThePictures) {
    std::vector<BoardView> views;
    for (int k = 0; k < 12; ++k)
        if (auto view = find_board(shot(GetParam(), k), GetParam())) views.push_back(*view);
    ASSERT_GE(views.size(), 9u);
    const auto found = calibrate(views, kTruth.width_px, kTruth.height_px);
    ASSERT_TRUE(found) << found.error().text;
    const bool checker =
        GetParam().kind == Board::Kind::kCheckerboard;  // its corners are saddles, sharper than those of tags
    EXPECT_LT(found->rms_px, checker ? 0.1 : 0.25);
    EXPECT_GT(found->tilt_deg, 30.0);
    EXPECT_LT(largest_difference_px(found->camera), 1.0);
    const double got[] = {found->camera.fx_px, found->camera.fy_px, found->camera.cx_px, found->camera.cy_px};
    const double want[] = {kTruth.fx_px, kTruth.fy_px, kTruth.cx_px, kTruth.cy_px};
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(got[i], want[i], 1.8) << i;
}
INSTANTIATE_TEST_SUITE_P(Boards, CalibrateCamera, ::testing::Values(kChecker, kTags), [](const auto& board) {
    return board.param.kind == Board::Kind::kCheckerboard ? "Checkerboard" : "AprilTags";
});

TEST(CalibrateCameraCommand, WritesWhatTheDriverReadsAndRefusesWhatIsOpen) {
    const test::ScratchFolder scratch;
    std::vector<std::string> words{"calibrate-camera", "--size", "0.02", "-o", (scratch.path() / "S1.toml").string()};
    for (int k = 0; k < 6; ++k) {
        words.push_back((scratch.path() / ("shot" + std::to_string(k) + ".png")).string());
        cv::imwrite(words.back(), shot(kChecker, k));
    }
    const auto run = test::run_teres(words);
    ASSERT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.output, ::testing::HasSubstr("reprojection error"));
    const auto info = read_calibration(scratch.path(), "S1", 640, 480);
    ASSERT_TRUE(info && *info);
    EXPECT_NEAR((*info)->fx_px, kTruth.fx_px, 3.0);
    EXPECT_NEAR((*info)->distortion[0], kTruth.distortion[0], 0.03);

    // One picture, six times over: nothing new is learnt from the copies.
    words.resize(5);
    words.insert(words.end(), 3, (scratch.path() / "shot0.png").string());
    const auto few = test::run_teres(words);
    EXPECT_EQ(few.exit_code, 1);
    EXPECT_THAT(few.error, ::testing::HasSubstr("at least 4"));
    words.insert(words.end(), 3, (scratch.path() / "shot0.png").string());
    const auto flat = test::run_teres(words);
    EXPECT_EQ(flat.exit_code, 1) << flat.output;
    EXPECT_THAT(flat.error, ::testing::HasSubstr("focal length"));

    cv::imwrite((scratch.path() / "small.png").string(), cv::Mat(240, 320, CV_8U, cv::Scalar(90)));
    words.push_back((scratch.path() / "small.png").string());
    const auto mixed = test::run_teres(words);
    EXPECT_EQ(mixed.exit_code, 2);
    EXPECT_THAT(mixed.error, ::testing::HasSubstr("small.png is 320x240"));
}

TEST(CalibrateCameraCommand, FindsHowThePairStandsAndRefusesPicturesThatAreNoPairs) {
    const test::ScratchFolder scratch;
    std::vector<std::string> left, right;
    for (int k = 0; k < 12; ++k)
        for (auto* side : {&left, &right}) {
            side->push_back(
                (scratch.path() / ((side == &left ? "left" : "right") + std::to_string(k) + ".png")).string());
            cv::imwrite(side->back(), shot(kChecker, k, side == &right));
        }
    const auto run = [&] {
        std::vector<std::string> words{"calibrate-camera",
                                       "--size",
                                       "0.02",
                                       "-o",
                                       (scratch.path() / "L.toml").string(),
                                       "--right-out",
                                       (scratch.path() / "R.toml").string()};
        words.insert(words.end(), left.begin(), left.end());
        words.push_back("--right");
        words.insert(words.end(), right.begin(), right.end());
        return test::run_teres(words);
    };
    const auto good = run();
    ASSERT_EQ(good.exit_code, 0) << good.error;
    EXPECT_THAT(good.output, ::testing::HasSubstr("reprojection error of the pair"));
    std::printf("%s", good.output.c_str());
    const auto info = read_calibration(scratch.path(), "R", 640, 480);
    ASSERT_TRUE(info && *info);
    const auto stream = stream_info(**info);
    ASSERT_TRUE(stream) << stream.error().text;
    EXPECT_EQ(stream->reference_frame, "camera_left");
    EXPECT_NEAR(stream->baseline_m, kShift.norm(), 2e-4);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(stream->to_reference.t[static_cast<std::size_t>(a)], kShift(a), 4e-4) << a;
    const Eigen::Matrix3d R =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(stream->to_reference.R.data());
    EXPECT_LT(Eigen::AngleAxisd(R * kTurn.transpose()).angle(), 4e-3);

    std::rotate(right.begin(), right.begin() + 1, right.end());
    const auto mixed = run();
    EXPECT_EQ(mixed.exit_code, 1);
    EXPECT_THAT(mixed.error, ::testing::HasSubstr("at the same time"));
    right.pop_back();
    const auto fewer = run();
    EXPECT_EQ(fewer.exit_code, 2);
    EXPECT_THAT(fewer.error, ::testing::HasSubstr("must be pairs"));
}

}  // namespace
}  // namespace teres::tools
