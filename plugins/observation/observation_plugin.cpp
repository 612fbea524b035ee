// Unit `observation`: camera frames in; MARKERS (one per frame pair, lost markers NaN) and TRACKING out, stamped with the
// capture time of the frame, so that a replay gives the same bytes.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>

#include "core/case/case_reader.h"
#include "core/plugin_sdk.h"
#include "plugins/observation/frame_check.h"
#include "plugins/observation/frame_clock.h"
#include "plugins/observation/marker_tracker.h"
#include "plugins/observation/observation_settings.h"
#include "plugins/observation/stereo_lift.h"
#include "teres/camera_info_t.hpp"
#include "teres/image_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/tracking_t.hpp"

namespace teres {
namespace {

constexpr std::size_t kMaxImageBytes = 32 << 20, kMaxInfoBytes = 1 << 16;
constexpr int kSwappedAfter = 5;      // frames in a row in which the pair only fits with its cameras exchanged
constexpr std::size_t kMinFits = 4;  // dots that do

double seconds(std::int64_t us) {
    return 1e-6 * static_cast<double>(us);
}

}  // namespace

class ObservationPlugin final : public Unit {
  public:
    using Settings = ObservationSettings;
    Settings settings;

    explicit ObservationPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override {
        if (settings.case_folder.empty())
            return invalid_input("observation.case (or service.case) names no case folder");
        CaseReadOptions reading;
        reading.observations = false;
        TERES_TRY_ASSIGN(case_, read_case(settings.case_folder, reading));
        settings.tracker.bright = settings.markers == "bright";
        return {};
    }

    Status start() override {
        const bool stereo = settings.source == "stereo";
        first_ = std::make_unique<Stream>(stereo ? "CAMERA_LEFT" : "CAMERA_COLOR", FrameCheck::Kind::kGrey);
        second_ = std::make_unique<Stream>(stereo ? "CAMERA_RIGHT" : "CAMERA_DEPTH",
                                           stereo ? FrameCheck::Kind::kGrey : FrameCheck::Kind::kDepth);
        color_to_case_.reset();
        swapped_in_a_row_ = 0;
        tracker_.reset();
        clock_ = {};
        frames_ = tracked_ = 0;
        sequence_ = tracking_sequence_ = 0;
        next_publish_us_ = std::numeric_limits<std::int64_t>::min();
        for (Stream* stream : {first_.get(), second_.get()}) {
            TERES_TRY(host_.subscribe<image_t>(stream->channel.c_str(), kMaxImageBytes,
                                               [this, stream](const image_t& m, std::int64_t) { take(*stream, m); }));
            TERES_TRY(host_.subscribe<camera_info_t>((stream->channel + "_INFO").c_str(), kMaxInfoBytes,
                                                     [this, stream](const camera_info_t& m, std::int64_t) { take_info(*stream, m); }));
        }
        if (!stereo) return {};
        return host_.subscribe<camera_info_t>("CAMERA_COLOR_INFO", kMaxInfoBytes, [this](const camera_info_t& m, std::int64_t) {
            if (const auto info = stream_info(m); info && info->reference_frame == case_.name) color_to_case_ = info->to_reference;
        });
    }

    teres_step_outcome step(std::int64_t) noexcept override try {
        if (!first_ || !first_->image || !second_->image) return TERES_STEP_IDLE;
        const std::int64_t apart_us = first_->header.capture_stamp_us - second_->header.capture_stamp_us;
        if (std::abs(seconds(apart_us)) > settings.pair_tolerance_s) {
            Stream& older = apart_us < 0 ? *first_ : *second_;
            older.image.reset();
            older.check.count(FrameFault::kUnpaired);
            return TERES_STEP_DEGRADED;
        }
        const bool good = work();
        first_->image.reset();
        second_->image.reset();
        return good ? TERES_STEP_DONE : TERES_STEP_DEGRADED;
    } catch (const std::exception& e) {  // OpenCV, out of memory: this frame is lost, the next one is new
        warn_once("frame dropped: " + std::string(e.what()));
        first_->image.reset();
        second_->image.reset();
        return TERES_STEP_DEGRADED;
    }

    void stop() override {
        tracker_.reset();
        first_.reset();
        second_.reset();
    }

  private:
    struct Stream {
        Stream(std::string name, FrameCheck::Kind kind) : channel(std::move(name)), check(kind) {}
        std::string channel;
        FrameCheck check;
        std::optional<cv::Mat> image;  // waits for its pair
        header_t header;
    };

    void take_info(Stream& stream, const camera_info_t& message) {
        const auto info = stream_info(message);
        if (!info) return warn_once(stream.channel + ": " + info.error().text);
        const auto& old = stream.check.info();
        if (old && camera_bytes(to_message(*old)) == camera_bytes(to_message(*info))) return;
        stream.check.set_info(*info);
        tracker_.reset();  // made anew with the first frame
    }

    static std::vector<std::uint8_t> camera_bytes(const camera_info_t& m) {
        std::vector<std::uint8_t> bytes(static_cast<std::size_t>(m.getEncodedSize()));
        m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
        return bytes;
    }

    void take(Stream& stream, const image_t& message) {
        if (&stream == first_.get()) clock_.add(message.header.capture_stamp_us, host_.now_us());
        if (stream.image) stream.check.count(FrameFault::kUnpaired);
        stream.image = stream.check.take(message);
        stream.header = message.header;
        if (stream.image) return;
        warn_once(stream.channel + ": bad frames, counted in TRACKING");
        publish_tracking(message.header, nullptr);
    }

    // Where the tracking camera stands: its stream says so, or that of the colour camera which it refers to, else the case.
    std::optional<Pose> camera_to_case() const {
        const StreamInfo& info = *first_->check.info();
        if (info.reference_frame == case_.name) return info.to_reference;
        auto pose = color_to_case_ ? color_to_case_ : camera_pose(case_.sensor);
        if (pose && info.reference_frame == "camera_color") pose = *pose * info.to_reference;
        return pose;
    }

    bool make_tracker() {
        const auto pose = camera_to_case();
        if (!pose) {
            warn_once("no pose of " + first_->channel + ": neither its info nor the case's sensor gives one");
            first_->check.count(FrameFault::kNoCalibration);
            return false;
        }
        std::vector<Eigen::Vector3d> rest;
        for (const MarkerRest& marker : case_.markers)
            rest.emplace_back(marker.position_m[0], marker.position_m[1], marker.position_m[2]);
        tracker_ = std::make_unique<MarkerTracker>(std::move(rest), first_->check.info()->camera, *pose, settings.tracker);
        return true;
    }

    bool work() {
        ++frames_;
        if (!tracker_ && !make_tracker()) return false;
        const StreamInfo& first = *first_->check.info();
        const StreamInfo& second = *second_->check.info();
        // x_first = R x_second + t, or both stand in the same reference frame.
        const Pose second_to_first = second.reference_frame == first.frame_id ? second.to_reference
                                                                              : first.to_reference.inverse() * second.to_reference;
        if (settings.source == "depth") {
            tracker_->track(*first_->image, DepthLift(*second_->image, second.depth_unit_m, second.camera, first.camera,
                                                      second_to_first.inverse(), settings.lift));
        } else {
            const StereoPair pair{first.camera, second.camera, second_to_first};
            find_dots(*second_, right_dots_);
            MeetingOptions meeting;
            meeting.min_area_ratio = settings.tracker.min_area_ratio;
            tracker_->track(*first_->image, StereoLift(pair, right_dots_, settings.lift, meeting));
            if (swapped(pair)) return false;
        }
        const std::vector<MarkerSight>& sights = tracker_->sights();
        ++tracked_;
        publish_markers(sights);
        publish_tracking(first_->header, &sights);
        return std::any_of(sights.begin(), sights.end(), [](const MarkerSight& s) { return s.seen(); });
    }

    void find_dots(const Stream& stream, std::vector<Blob>& dots) const {
        const CameraModel& camera = stream.check.info()->camera;
        const BlobOptions options{settings.tracker.bright, settings.tracker.diameter_m * camera.fx_px / tracker_->mean_z_m(), settings.tracker.contrast};
        find_blobs(*stream.image, {0, 0, camera.width_px, camera.height_px}, options, dots);
    }

    // Images of exchanged cameras only meet the other way round.
    bool swapped(const StereoPair& pair) {
        const auto seen = [](const MarkerSight& s) { return s.seen(); };
        std::size_t fits = 0;
        if (std::none_of(tracker_->sights().begin(), tracker_->sights().end(), seen)) {
            std::vector<Blob> left_dots;
            find_dots(*first_, left_dots);
            MeetingOptions anywhere;
            anywhere.depth_gate_m = 1.0;
            anywhere.unmistakable = 0.0;
            const StereoLift exchanged(pair, left_dots, settings.lift, anywhere);
            for (const Blob& dot : right_dots_) fits += exchanged.at(dot, tracker_->mean_z_m()) ? 1 : 0;
        }
        swapped_in_a_row_ = fits >= kMinFits && 2 * fits >= right_dots_.size() ? swapped_in_a_row_ + 1 : 0;
        if (swapped_in_a_row_ < kSwappedAfter) return false;
        second_->check.count(FrameFault::kSwapped);
        warn_once("left and right camera are exchanged");
        publish_tracking(first_->header, nullptr);
        return true;
    }

    void publish_markers(const std::vector<MarkerSight>& sights) {
        if (first_->header.capture_stamp_us < next_publish_us_) return;
        next_publish_us_ = first_->header.capture_stamp_us + std::llround(1e6 * settings.publish_period_s) - 1;
        const std::size_t count = sights.size();
        markers_.header.capture_stamp_us = first_->header.capture_stamp_us;
        markers_.header.sequence = sequence_++;
        markers_.header.frame_id = case_.name;
        markers_.num_markers = static_cast<std::int32_t>(count);
        markers_.marker_id.resize(count);
        const double missing = std::numeric_limits<double>::quiet_NaN();
        for (auto* axis : {&markers_.x_m, &markers_.y_m, &markers_.z_m}) axis->assign(count, missing);
        markers_.sigma_m.assign(count, 0.0);
        for (std::size_t i = 0; i < count; ++i) {
            markers_.marker_id[i] = case_.markers[i].id;
            if (!sights[i].seen()) continue;
            markers_.x_m[i] = sights[i].x.x();
            markers_.y_m[i] = sights[i].x.y();
            markers_.z_m[i] = sights[i].x.z();
            markers_.sigma_m[i] = settings.sigma_factor * std::sqrt(sights[i].covariance.trace() / 3.0);
        }
        host_.publish("MARKERS", markers_);
    }

    void publish_tracking(const header_t& header, const std::vector<MarkerSight>* sights) {
        tracking_.header.capture_stamp_us = header.capture_stamp_us;
        tracking_.header.sequence = tracking_sequence_++;
        tracking_.header.frame_id = header.frame_id;
        tracking_.latency_s = clock_.latency_s();
        tracking_.clock_offset_s = clock_.offset_s();
        tracking_.clock_drift_ppm = clock_.drift_ppm();
        tracking_.frames = frames_;
        tracking_.frames_tracked = tracked_;
        tracking_.fault.clear();
        tracking_.fault_frames.clear();
        for (const Stream* stream : {first_.get(), second_.get()})
            for (int f = 0; f < static_cast<int>(FrameFault::kCount); ++f) {
                const auto fault = static_cast<FrameFault>(f);
                if (stream->check.count_of(fault) == 0) continue;
                tracking_.fault.push_back(stream->channel + " " + fault_name(fault));
                tracking_.fault_frames.push_back(stream->check.count_of(fault));
            }
        tracking_.num_faults = static_cast<std::int32_t>(tracking_.fault.size());
        const std::size_t count = sights != nullptr ? sights->size() : 0;
        const float missing = std::numeric_limits<float>::quiet_NaN();
        tracking_.num_markers = static_cast<std::int32_t>(count);
        tracking_.marker_id.resize(count);
        tracking_.status.resize(count);
        tracking_.u_px.assign(count, missing);
        tracking_.v_px.assign(count, missing);
        for (std::size_t i = 0; i < count; ++i) {
            const MarkerSight& sight = (*sights)[i];
            tracking_.marker_id[i] = case_.markers[i].id;
            tracking_.status[i] = static_cast<std::int8_t>(sight.status);
            if (sight.status == MarkerStatus::kMissing) continue;
            tracking_.u_px[i] = static_cast<float>(sight.pixel.u);
            tracking_.v_px[i] = static_cast<float>(sight.pixel.v);
        }
        tracking_.swaps = tracker_ ? tracker_->swaps() : 0;
        tracking_.rejected = tracker_ ? tracker_->rejected() : 0;
        host_.publish("TRACKING", tracking_);
    }

    void warn_once(const std::string& text) {
        if (std::find(warned_.begin(), warned_.end(), text) != warned_.end() || warned_.size() > 64) return;
        warned_.push_back(text);
        host_.log(TERES_LOG_WARN, "observation", text);
    }

    Host host_;
    Case case_;
    std::unique_ptr<Stream> first_, second_;
    std::unique_ptr<MarkerTracker> tracker_;
    std::optional<Pose> color_to_case_;  // stereo: the pair may refer to the colour camera
    std::vector<Blob> right_dots_;
    int swapped_in_a_row_ = 0;
    FrameClock clock_;
    std::int64_t frames_ = 0, tracked_ = 0, sequence_ = 0, tracking_sequence_ = 0, next_publish_us_ = 0;
    markers_t markers_{};
    tracking_t tracking_{};
    std::vector<std::string> warned_;
};

}  // namespace teres

TERES_PLUGIN(teres::ObservationPlugin, "observation", "camera frames to 3-D markers", TERES_UNIT_PLUGIN)
