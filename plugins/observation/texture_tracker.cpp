#include "plugins/observation/texture_tracker.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

namespace teres {
namespace {

constexpr int kPyramidLevels = 2;
const cv::Size kFlowWindow(21, 21);
constexpr double kGrain_px = 1.0;    // finer than this is noise of the sensor
constexpr double kLocal_px = 10.0;   // the local mean reaches so far
constexpr double kAgree_px = 3.0;    // between the flow from the frame before and that from the start
constexpr int kMaxUnconfirmed = 15;  // frames
constexpr std::size_t kMinFeatures = 8, kMinNeighbours = 5;
constexpr double kMaxPatchError = 24.0;  // mean grey difference of two patches of the same place

cv::Point2f cv_point(const Pixel& p) {
    return {static_cast<float>(p.u), static_cast<float>(p.v)};
}
Point point(const Eigen::Vector3d& x) {
    return {x.x(), x.y(), x.z()};
}

std::vector<cv::Mat> view_of(const cv::Mat& grey) {
    cv::Mat log_view, mean, view;
    grey.convertTo(log_view, CV_32F, 1.0, 6.0);  // darker than 6 the logarithm flattens: noise stays small
    cv::log(log_view, log_view);
    cv::GaussianBlur(log_view, log_view, cv::Size(), kGrain_px);
    cv::GaussianBlur(log_view, mean, cv::Size(), kLocal_px);
    cv::Mat(log_view - mean).convertTo(view, CV_8U, 200.0, 128.0);
    std::vector<cv::Mat> pyramid;
    cv::buildOpticalFlowPyramid(view, pyramid, kFlowWindow, kPyramidLevels);
    return pyramid;
}

}  // namespace

bool TextureTracker::start(const cv::Mat& grey, const cv::Mat& range_m, const Lift& lift) {
    features_.clear();
    tracks_.clear();
    first_ = view_of(grey);
    cv::Mat mask = range_m > 0.0F;
    cv::erode(mask, mask, cv::Mat::ones(kFlowWindow, CV_8U));
    double nearest = 0.0;
    cv::minMaxLoc(range_m, nullptr, &nearest, nullptr, nullptr, mask);
    if (!(nearest > 0.0)) return false;
    std::vector<cv::Point2f> corners;
    cv::goodFeaturesToTrack(first_[0], corners, 2 * options_.features, options_.quality,
                            options_.spacing_m * camera_.fx_px / nearest, mask, 5);
    for (const cv::Point2f& corner : corners) {
        if (static_cast<int>(features_.size()) == options_.features) break;
        const Pixel pixel{corner.x, corner.y};
        const double expected =
            range_m.at<float>(static_cast<int>(std::lround(pixel.v)), static_cast<int>(std::lround(pixel.u)));
        const auto lifted = lift.at({pixel}, expected);
        if (!lifted || std::abs(lifted->x.z() - expected) > options_.consistency_limit_m) continue;
        Feature& feature = features_.emplace_back();
        const Point rest = pose_.apply(point(lifted->x));
        feature.rest = {rest[0], rest[1], rest[2]};
        tracks_.push_back({pixel, pixel, true, 0, feature.rest});
        place(features_.size() - 1, lift);
    }
    before_ = first_;
    return features_.size() >= kMinFeatures;
}

TextureTracker::Flow TextureTracker::flow(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to,
                                          const std::vector<cv::Point2f>& points,
                                          const std::vector<cv::Point2f>& guess) const {
    Flow result{guess, std::vector<bool>(points.size(), false)};
    if (points.empty()) return result;
    const cv::TermCriteria until(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
    std::vector<std::uint8_t> there, returned;
    std::vector<float> error;
    std::vector<cv::Point2f> back = points;
    cv::calcOpticalFlowPyrLK(from, to, points, result.to, there, error, kFlowWindow, kPyramidLevels, until,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    cv::calcOpticalFlowPyrLK(to, from, result.to, back, returned, cv::noArray(), kFlowWindow, kPyramidLevels, until,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    for (std::size_t i = 0; i < points.size(); ++i)
        result.good[i] = there[i] != 0 && returned[i] != 0 && error[i] < kMaxPatchError &&
                         cv::norm(back[i] - points[i]) < options_.max_flow_error_px;
    return result;
}

const std::vector<Feature>& TextureTracker::track(const cv::Mat& grey, const Lift& lift) {
    const std::vector<Neighbour> seen = neighbours();
    const std::vector<cv::Mat> now = view_of(grey);
    std::vector<cv::Point2f> starts, before;
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
        Track& track = tracks_[i];
        if (!features_[i].sight.seen() && seen.size() >= kMinNeighbours)
            if (const auto x = predict_from_neighbours(seen, i, features_[i].rest, options_.neighbour_reach_m))
                track.last = *x;
        if (!track.on_image)
            if (const auto expected = camera_.project(to_camera_.apply(point(track.last)))) track.pixel = *expected;
        starts.push_back(cv_point(track.start));
        before.push_back(cv_point(track.pixel));
    }
    Flow carried = flow(before_, now, before, before);
    for (std::size_t i = 0; i < tracks_.size(); ++i)
        if (!tracks_[i].on_image || !carried.good[i]) {
            carried.good[i] = false;
            carried.to[i] = before[i];
        }
    const Flow confirmed = flow(first_, now, starts, carried.to);
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
        Track& track = tracks_[i];
        const bool fits =
            confirmed.good[i] && (!carried.good[i] || cv::norm(confirmed.to[i] - carried.to[i]) < kAgree_px);
        track.unconfirmed = fits ? 0 : track.unconfirmed + 1;
        track.on_image = fits || (carried.good[i] && track.unconfirmed <= kMaxUnconfirmed);
        const cv::Point2f& p = fits ? confirmed.to[i] : carried.to[i];
        track.pixel = {p.x, p.y};
        features_[i].sight = {};
        if (track.on_image) place(i, lift);
    }
    verify();
    before_ = now;
    return features_;
}

void TextureTracker::place(std::size_t i, const Lift& lift) {
    Track& track = tracks_[i];
    MarkerSight& sight = features_[i].sight;
    sight.pixel = track.pixel;
    sight.status = MarkerStatus::kRejected;
    const double guess_z_m = std::max(1e-3, to_camera_.apply(point(track.last))[2]);
    const auto lifted = lift.at({track.pixel}, guess_z_m);
    if (!lifted || std::abs(lifted->x.z() - guess_z_m) > options_.consistency_limit_m) return;
    sight.status = track.unconfirmed == 0 ? MarkerStatus::kTracked : MarkerStatus::kFound;
    const Point x = pose_.apply(point(lifted->x));
    sight.x = {x[0], x[1], x[2]};
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(pose_.R.data());
    sight.covariance = R * lifted->covariance * R.transpose();
}

// The worst stray goes first: it spoils the predictions of its neighbours.
void TextureTracker::verify() {
    for (;;) {
        const std::vector<Neighbour> seen = neighbours();
        if (seen.size() < kMinNeighbours) break;
        double worst = options_.consistency_limit_m;
        std::size_t stray = features_.size();
        for (const Neighbour& n : seen) {
            const auto x = predict_from_neighbours(seen, n.marker, n.X, options_.neighbour_reach_m);
            if (!x || (n.x - *x).norm() <= worst) continue;
            worst = (n.x - *x).norm();
            stray = n.marker;
        }
        if (stray == features_.size()) break;
        features_[stray].sight.status = MarkerStatus::kRejected;
        tracks_[stray].on_image = false;
    }
    for (std::size_t i = 0; i < features_.size(); ++i)
        if (features_[i].sight.seen()) tracks_[i].last = features_[i].sight.x;
}

std::vector<Neighbour> TextureTracker::neighbours() const {
    std::vector<Neighbour> seen;
    for (std::size_t i = 0; i < features_.size(); ++i)
        if (features_[i].sight.seen()) seen.push_back({i, features_[i].rest, features_[i].sight.x});
    return seen;
}

}  // namespace teres
