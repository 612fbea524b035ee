#include "plugins/observation/marker_tracker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/video/tracking.hpp>

namespace teres {
namespace {

constexpr int kPyramidLevels = 3;
const cv::Size kFlowWindow(21, 21);
constexpr double kClaimRadius = 0.4;   // of a dot's diameter: a dot this near to the flow's end is the marker
constexpr double kUnmistakable = 2.0;  // the second nearest dot must be this many times further away
constexpr double kOffsetMemory = 0.1;  // weight of a frame in the slow means
constexpr double kAreaRelaxation = 0.03;
constexpr std::size_t kMinNeighbours = 4;
constexpr int kTrialFrames = 3;  // a found marker counts as tracked after so many

Eigen::Vector3d vec(const Point& p) {
    return {p[0], p[1], p[2]};
}
Point point(const Eigen::Vector3d& x) {
    return {x.x(), x.y(), x.z()};
}
double distance_px(const Pixel& a, const Pixel& b) {
    return std::hypot(a.u - b.u, a.v - b.v);
}

}  // namespace

MarkerTracker::MarkerTracker(std::vector<Eigen::Vector3d> rest, const CameraModel& camera, const Pose& pose,
                             const TrackerOptions& options)
    : camera_(camera), pose_(pose), to_camera_(pose.inverse()), options_(options), last_(rest) {
    for (const Eigen::Vector3d& X : rest) tracks_.emplace_back().rest = X;
    sights_.resize(tracks_.size());
}

const std::vector<MarkerSight>& MarkerTracker::track(const cv::Mat& grey, const Lift& lift) {
    for (MarkerSight& sight : sights_) sight = {};
    std::vector<cv::Mat> pyramid;
    cv::buildOpticalFlowPyramid(grey, pyramid, kFlowWindow, kPyramidLevels);
    carry_by_flow(pyramid);
    detect(grey);
    claim_carried(lift);
    find_lost(lift);
    mend_swaps();
    verify();
    remember();
    pyramid_ = std::move(pyramid);
    return sights_;
}

void MarkerTracker::carry_by_flow(const std::vector<cv::Mat>& pyramid) {
    std::vector<std::size_t> carried;
    std::vector<cv::Point2f> from, to, back;
    for (std::size_t i = 0; i < tracks_.size(); ++i)
        if (tracks_[i].on_image && !pyramid_.empty()) {
            carried.push_back(i);
            from.emplace_back(static_cast<float>(tracks_[i].pixel.u), static_cast<float>(tracks_[i].pixel.v));
        }
    for (Track& track : tracks_) track.on_image = false;
    if (carried.empty()) return;
    std::vector<std::uint8_t> there, returned;
    cv::calcOpticalFlowPyrLK(pyramid_, pyramid, from, to, there, cv::noArray(), kFlowWindow, kPyramidLevels);
    back = from;
    cv::calcOpticalFlowPyrLK(pyramid, pyramid_, to, back, returned, cv::noArray(), kFlowWindow, kPyramidLevels,
                             cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01),
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    for (std::size_t k = 0; k < carried.size(); ++k) {
        const cv::Point2f error = back[k] - from[k];
        if (there[k] == 0 || returned[k] == 0 || std::hypot(error.x, error.y) > options_.max_flow_error_px) continue;
        tracks_[carried[k]].on_image = true;
        tracks_[carried[k]].pixel = {to[k].x, to[k].y};
    }
}

void MarkerTracker::detect(const cv::Mat& grey) {
    double u0 = camera_.width_px, v0 = camera_.height_px, u1 = 0.0, v1 = 0.0;
    for (const Eigen::Vector3d& x : last_) {
        const auto expected = expect(x, options_.start_gate_m);
        if (!expected) continue;
        const double margin = expected->gate_px + options_.diameter_m * camera_.fx_px / expected->z_m;
        u0 = std::min(u0, expected->pixel.u - margin);
        v0 = std::min(v0, expected->pixel.v - margin);
        u1 = std::max(u1, expected->pixel.u + margin);
        v1 = std::max(v1, expected->pixel.v + margin);
    }
    BlobOptions options;
    options.bright = options_.bright;
    options.contrast = options_.contrast;
    options.diameter_px = options_.diameter_m * camera_.fx_px / mean_z_m();
    const cv::Point low(static_cast<int>(u0), static_cast<int>(v0)),
        high(static_cast<int>(u1) + 1, static_cast<int>(v1) + 1);
    find_blobs(grey, low.x < high.x && low.y < high.y ? cv::Rect(low, high) : cv::Rect(), options, blobs_);
    claimed_.assign(blobs_.size(), false);
}

void MarkerTracker::claim_carried(const Lift& lift) {
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
        Track& track = tracks_[i];
        if (!track.on_image) continue;
        const double radius = kClaimRadius * options_.diameter_m * camera_.fx_px / z_of(last_[i]);
        std::size_t best = blobs_.size();
        for (std::size_t b = 0; b < blobs_.size(); ++b)
            if (!claimed_[b] && distance_px(blobs_[b].center, track.pixel) < radius &&
                (best == blobs_.size() ||
                 distance_px(blobs_[b].center, track.pixel) < distance_px(blobs_[best].center, track.pixel)))
                best = b;
        if (best == blobs_.size()) {
            track.on_image = false;
            continue;
        }
        claimed_[best] = true;
        take(i, blobs_[best], z_of(last_[i]), options_.consistency_limit_m, lift,
             track.found_frames < kTrialFrames ? MarkerStatus::kFound : MarkerStatus::kTracked);
    }
}

void MarkerTracker::find_lost(const Lift& lift) {
    struct Candidate {
        std::size_t marker, blob;
        double distance;
    };
    // Two rounds: what the first finds helps to predict the rest.
    for (int round = 0; round < 2; ++round) {
        const std::vector<Neighbour> seen = neighbours();
        std::vector<std::optional<Expected>> expected(tracks_.size());
        for (std::size_t i = 0; i < tracks_.size(); ++i) {
            if (sights_[i].status != MarkerStatus::kMissing) continue;
            const auto x = seen.size() >= kMinNeighbours ? predict(seen, i) : std::nullopt;
            if (x) last_[i] = *x;
            expected[i] = expect(last_[i], x && tracks_[i].known ? options_.find_gate_m : options_.start_gate_m);
        }
        std::vector<Candidate> candidates;
        for (std::size_t b = 0; b < blobs_.size(); ++b) {
            if (claimed_[b]) continue;
            // The dot's nearest expected marker, and the marker's nearest dot, both without a close second.
            for (std::size_t i = 0; i < tracks_.size(); ++i) {
                if (!expected[i]) continue;
                const double d = distance_px(expected[i]->pixel, blobs_[b].center);
                if (d > expected[i]->gate_px) continue;
                bool unmistakable = true;
                for (std::size_t j = 0; j < tracks_.size(); ++j)
                    if (j != i && expected[j] && distance_px(expected[j]->pixel, blobs_[b].center) < kUnmistakable * d)
                        unmistakable = false;
                for (std::size_t other = 0; other < blobs_.size(); ++other)
                    if (other != b && !claimed_[other] &&
                        distance_px(expected[i]->pixel, blobs_[other].center) < kUnmistakable * d)
                        unmistakable = false;
                if (unmistakable) candidates.push_back({i, b, d});
            }
        }
        for (const Candidate& c : candidates) {
            claimed_[c.blob] = true;
            tracks_[c.marker].found_frames = 0;
            const double gate_m = tracks_[c.marker].known ? 2.0 * options_.find_gate_m : options_.start_gate_m;
            take(c.marker, blobs_[c.blob], expected[c.marker]->z_m, gate_m, lift, MarkerStatus::kFound);
        }
    }
}

void MarkerTracker::take(std::size_t marker, const Blob& blob, double guess_z_m, double gate_m, const Lift& lift,
                         MarkerStatus as) {
    Track& track = tracks_[marker];
    MarkerSight& sight = sights_[marker];
    track.on_image = true;
    track.pixel = sight.pixel = blob.center;
    sight.status = MarkerStatus::kRejected;
    const auto lifted = lift.at(blob, guess_z_m);
    if (!lifted || std::abs(lifted->x.z() - guess_z_m) > gate_m) return;  // in front of it or behind
    // Part of the dot behind something: its centre is not the marker's.
    const double full_px = options_.diameter_m * camera_.fx_px / lifted->x.z(),
                 ratio = blob.area_px / (full_px * full_px);
    const bool whole = !track.known || (ratio > options_.min_area_ratio * track.area_ratio &&
                                        ratio * options_.min_area_ratio < track.area_ratio);
    // Slowly also while it does not fit: the view may have changed while the marker was away.
    track.area_ratio += (!track.known ? 1.0 : whole ? kOffsetMemory : kAreaRelaxation) * (ratio - track.area_ratio);
    if (!whole) return;
    sight.status = as;
    sight.x = vec(pose_.apply(point(lifted->x)));
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(pose_.R.data());
    sight.covariance = R * lifted->covariance * R.transpose();
}

// Two markers whose places fit the other's neighbours better than their own.
void MarkerTracker::mend_swaps() {
    const std::vector<Neighbour> seen = neighbours();
    if (seen.size() < kMinNeighbours) return;
    for (std::size_t a = 0; a < seen.size(); ++a)
        for (std::size_t b = a + 1; b < seen.size(); ++b) {
            const std::size_t i = seen[a].marker, j = seen[b].marker;
            if (!tracks_[i].known || !tracks_[j].known) continue;
            std::vector<Neighbour> others;
            for (const Neighbour& n : seen)
                if (n.marker != i && n.marker != j) others.push_back(n);
            if (others.size() < kMinNeighbours) continue;
            const double apart = (sights_[i].x - sights_[j].x).norm();
            const auto pi = predict(others, i), pj = predict(others, j);
            if (!pi || !pj) continue;
            const double kept = (sights_[i].x - *pi).norm() + (sights_[j].x - *pj).norm();
            const double exchanged = (sights_[j].x - *pi).norm() + (sights_[i].x - *pj).norm();
            if (kept < apart || exchanged > 0.5 * kept) continue;
            std::swap(sights_[i], sights_[j]);
            std::swap(tracks_[i].pixel, tracks_[j].pixel);
            ++swaps_;
        }
}

// The worst stray goes first: it spoils the predictions of its neighbours.
void MarkerTracker::verify() {
    for (;;) {
        const std::vector<Neighbour> seen = neighbours();
        if (seen.size() < kMinNeighbours) return;
        double worst = 1.0;
        std::size_t stray = tracks_.size();
        for (const Neighbour& n : seen) {
            const auto x = predict(seen, n.marker);
            const double limit = tracks_[n.marker].known ? options_.consistency_limit_m : options_.start_gate_m;
            if (x && (n.x - *x).norm() / limit > worst) {
                worst = (n.x - *x).norm() / limit;
                stray = n.marker;
            }
        }
        if (stray == tracks_.size()) return;
        reject(stray);
    }
}

void MarkerTracker::reject(std::size_t marker) {
    sights_[marker].status = MarkerStatus::kRejected;
    tracks_[marker].on_image = false;
    ++rejected_;
}

void MarkerTracker::remember() {
    const std::vector<Neighbour> seen = neighbours();
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
        Track& track = tracks_[i];
        if (!sights_[i].seen()) continue;
        last_[i] = sights_[i].x;
        ++track.found_frames;
        if (seen.size() < kMinNeighbours + 1) continue;
        const auto x = predict_from_neighbours(seen, i, track.rest, options_.neighbour_reach_m);
        if (!x) continue;
        const Eigen::Vector3d offset = sights_[i].x - *x;
        track.offset += (track.known ? kOffsetMemory : 1.0) * (offset - track.offset);
        track.known = true;
    }
}

std::vector<Neighbour> MarkerTracker::neighbours() const {
    std::vector<Neighbour> seen;
    for (std::size_t i = 0; i < tracks_.size(); ++i)
        if (sights_[i].seen()) seen.push_back({i, tracks_[i].rest, sights_[i].x});
    return seen;
}

std::optional<Eigen::Vector3d> MarkerTracker::predict(const std::vector<Neighbour>& from, std::size_t marker) const {
    auto x = predict_from_neighbours(from, marker, tracks_[marker].rest, options_.neighbour_reach_m);
    if (x) *x += tracks_[marker].offset;
    return x;
}

std::optional<MarkerTracker::Expected> MarkerTracker::expect(const Eigen::Vector3d& x, double gate_m) const {
    const auto pixel = camera_.project(to_camera_.apply(point(x)));
    if (!pixel) return std::nullopt;
    return Expected{*pixel, z_of(x), gate_m * camera_.fx_px / z_of(x)};
}

double MarkerTracker::mean_z_m() const {
    double sum = 0.0;
    for (const Eigen::Vector3d& x : last_) sum += z_of(x);
    return last_.empty() ? 1.0 : sum / static_cast<double>(last_.size());
}

double MarkerTracker::z_of(const Eigen::Vector3d& x) const {
    return std::max(1e-3, to_camera_.apply(point(x))[2]);
}

}  // namespace teres
