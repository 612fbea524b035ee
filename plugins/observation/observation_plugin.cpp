// Unit `observation`: camera frames in (and LIVER_STATE: where the liver's surface is expected); MARKERS (one per frame
// pair, lost markers NaN), before them SURFACE_POINTS, TRACKING and REGISTRATION out, stamped with the capture time of
// the frame, so that a replay gives the same bytes.
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
#include "plugins/observation/landmarks.h"
#include "plugins/observation/marker_tracker.h"
#include "plugins/observation/observation_settings.h"
#include "plugins/observation/stereo_lift.h"
#include "plugins/observation/surface_sampler.h"
#include "teres/camera_info_t.hpp"
#include "teres/image_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/registration_t.hpp"
#include "teres/surface_points_t.hpp"
#include "teres/tracking_t.hpp"

namespace teres {
namespace {

constexpr std::size_t kMaxStateBytes = 8 << 20, kMaxImageBytes = 32 << 20, kMaxInfoBytes = 1 << 16;
constexpr int kSwappedAfter = 5;               // frames in a row in which the pair only fits with its cameras exchanged
constexpr std::int64_t kRetry_us = 1'000'000;  // between two attempts to register
constexpr std::size_t kMinFits = 4;            // dots that do

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

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
        if ((settings.surface_points > 0 || settings.features == "texture") && settings.source != "depth")
            return invalid_input(
                "observation.surface_points and observation.features = \"texture\" need observation.source = "
                "\"depth\": a stereo pair gives no depth image");
        landmarks_.clear();
        if (!settings.landmarks.empty()) {
            if (settings.registration != "surface" || settings.source != "depth")
                return invalid_input(
                    "observation.landmarks needs observation.registration = \"surface\" and observation.source = "
                    "\"depth\"");
            TERES_TRY_ASSIGN(landmarks_, read_landmarks(settings.landmarks));
        }
        settings.texture.max_flow_error_px = settings.tracker.max_flow_error_px;
        settings.texture.consistency_limit_m = settings.tracker.consistency_limit_m;
        settings.texture.neighbour_reach_m = settings.tracker.neighbour_reach_m;
        return {};
    }

    Status start() override {
        const bool stereo = settings.source == "stereo";
        first_ = std::make_unique<Stream>(stereo ? "CAMERA_LEFT" : "CAMERA_COLOR", FrameCheck::Kind::kGrey);
        second_ = std::make_unique<Stream>(stereo ? "CAMERA_RIGHT" : "CAMERA_DEPTH",
                                           stereo ? FrameCheck::Kind::kGrey : FrameCheck::Kind::kDepth);
        color_to_case_.reset();
        registration_.reset();
        start_.reset();
        next_attempt_us_ = last_seen_us_ = std::numeric_limits<std::int64_t>::min();
        swapped_in_a_row_ = 0;
        tracker_.reset();
        clock_ = {};
        frames_ = tracked_ = 0;
        sequence_ = tracking_sequence_ = 0;
        next_publish_us_ = std::numeric_limits<std::int64_t>::min();
        for (Stream* stream : {first_.get(), second_.get()}) {
            TERES_TRY(host_.subscribe<image_t>(stream->channel.c_str(), kMaxImageBytes,
                                               [this, stream](const image_t& m, std::int64_t) { take(*stream, m); }));
            TERES_TRY(host_.subscribe<camera_info_t>(
                (stream->channel + "_INFO").c_str(), kMaxInfoBytes,
                [this, stream](const camera_info_t& m, std::int64_t) { take_info(*stream, m); }));
        }
        sampler_.reset();
        liver_ = case_.mesh.nodes;
        if (settings.surface_points > 0) {
            sampler_ = std::make_unique<SurfaceSampler>(case_.mesh);
            TERES_TRY(host_.subscribe<liver_state_t>("LIVER_STATE", kMaxStateBytes,
                                                     [this](const liver_state_t& m, std::int64_t) { take_liver(m); }));
        }
        if (!stereo) return {};
        return host_.subscribe<camera_info_t>(
            "CAMERA_COLOR_INFO", kMaxInfoBytes, [this](const camera_info_t& m, std::int64_t) {
                if (const auto info = stream_info(m); info && info->reference_frame == case_.name)
                    color_to_case_ = info->to_reference;
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

    void take_liver(const liver_state_t& m) {
        if (m.x_m.size() != liver_.size()) return;
        for (std::size_t n = 0; n < liver_.size(); ++n) liver_[n] = {m.x_m[n], m.y_m[n], m.z_m[n]};
    }

    // Where the tracking camera stands: as found, else as landmarks say, else as its stream says, or that of the colour
    // camera which it refers to, or the case.
    std::optional<Pose> camera_to_case() const {
        if (registration_) return registration_->camera_to_case;
        if (start_) return start_;
        const StreamInfo& info = *first_->check.info();
        if (info.reference_frame == case_.name) return info.to_reference;
        auto pose = color_to_case_ ? color_to_case_ : camera_pose(case_.sensor);
        if (pose && info.reference_frame == "camera_color") pose = *pose * info.to_reference;
        return pose;
    }

    DepthLift depth_lift() const {
        const StreamInfo& depth = *second_->check.info();
        return {*second_->image,
                depth.depth_unit_m,
                depth.camera,
                first_->check.info()->camera,
                second_to_first().inverse(),
                settings.lift};
    }

    void start_from_landmarks() {
        if (landmarks_.empty() || start_) return;
        const auto stated = camera_to_case();
        const auto found =
            pose_from_landmarks(landmarks_, depth_lift(), stated ? std::max(0.05, stated->inverse().t[2]) : 0.3);
        if (!found) return warn_once("landmarks: " + found.error().text + "; tried again");
        start_ = found->camera_to_case;
        tracker_.reset();
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
        tracker_ =
            std::make_unique<MarkerTracker>(std::move(rest), first_->check.info()->camera, *pose, settings.tracker);
        texture_.reset();
        return true;
    }

    bool work() {
        ++frames_;
        start_from_landmarks();
        if (!tracker_ && !make_tracker()) return false;
        const bool stereo = settings.source == "stereo";
        const StreamInfo& second = *second_->check.info();
        const StereoPair pair{first_->check.info()->camera, second.camera, second_to_first()};
        std::unique_ptr<Lift> lift;
        if (stereo) {
            find_dots(*second_, right_dots_);
            MeetingOptions meeting;
            meeting.min_area_ratio = settings.tracker.min_area_ratio;
            lift = std::make_unique<StereoLift>(pair, right_dots_, settings.lift, meeting);
        } else {
            lift = std::make_unique<DepthLift>(depth_lift());
        }
        if (settings.registration == "surface" && !registered(*lift)) return false;
        if (settings.features == "texture" && !track_texture(*lift)) return false;
        const std::vector<MarkerSight>& sights = texture_ ? tracker_->sights() : tracker_->track(*first_->image, *lift);
        if (stereo && swapped(pair)) return false;
        const bool seen =
            texture_ ? std::ranges::any_of(texture_->features(), [](const Feature& f) { return f.sight.seen(); })
                     : std::ranges::any_of(sights, [](const MarkerSight& s) { return s.seen(); });
        if (seen) last_seen_us_ = first_->header.capture_stamp_us;
        ++tracked_;
        if (publishes_now()) {
            publish_surface();
            publish_markers(sights);
        }
        publish_tracking(first_->header, &sights);
        return seen;
    }

    // The frame that they are chosen in shows the liver at rest.
    bool track_texture(const Lift& lift) {
        if (texture_) {
            texture_->track(*first_->image, lift);
            return true;
        }
        const CameraModel& camera = first_->check.info()->camera;
        ZBuffer buffer(camera.width_px, camera.height_px);
        std::vector<ZBuffer::Vertex> vertices;
        ZBuffer::project(case_.mesh.nodes, camera_to_case()->inverse(), camera, vertices);
        buffer.draw(vertices, Surface(case_.mesh).triangles());
        cv::Mat range_m(camera.height_px, camera.width_px, CV_32F);
        for (int v = 0; v < range_m.rows; ++v)
            for (int u = 0; u < range_m.cols; ++u) range_m.at<float>(v, u) = buffer.z_m(u, v);
        auto texture = std::make_unique<TextureTracker>(camera, *camera_to_case(), settings.texture);
        if (!texture->start(*first_->image, range_m, lift)) {
            warn_once("too little texture on the liver to track");
            return false;
        }
        texture_ = std::move(texture);
        return true;
    }

    // x_first = R x_second + t, or both stand in the same reference frame.
    Pose second_to_first() const {
        const StreamInfo &first = *first_->check.info(), &second = *second_->check.info();
        return second.reference_frame == first.frame_id ? second.to_reference
                                                        : first.to_reference.inverse() * second.to_reference;
    }

    // Finds the pose at the start, and anew after a long time without markers; until then there are none.
    bool registered(const Lift& lift) {
        const std::int64_t now_us = first_->header.capture_stamp_us;
        const bool lost = registration_ && settings.registration_lost_s > 0.0 &&
                          seconds(now_us - last_seen_us_) > settings.registration_lost_s;
        if ((registration_ && !lost) || now_us < next_attempt_us_) return registration_.has_value();
        next_attempt_us_ = now_us + kRetry_us;
        const auto found = register_camera(lift);
        publish_registration(found);
        if (!found) {
            warn_once("camera not registered to the model: " + found.error().text);
            return registration_.has_value();
        }
        registration_ = *found;
        last_seen_us_ = now_us;
        return make_tracker();
    }

    Result<Registration> register_camera(const Lift& lift) const {
        std::vector<Blob> blobs;
        find_dots(*first_, blobs);
        std::vector<SeenDot> dots;
        for (const Blob& blob : blobs)
            if (const auto x = lift.at(blob, tracker_->mean_z_m()))
                dots.push_back({{x->x.x(), x->x.y(), x->x.z()}, std::sqrt(x->covariance.trace() / 3.0)});
        std::vector<Point> markers, points;
        for (const MarkerRest& marker : case_.markers) markers.push_back(marker.position_m);
        if (settings.source == "depth") {
            const StreamInfo& depth = *second_->check.info();
            points = depth_points({second_->image->ptr<std::uint16_t>(), second_->image->total()}, depth.camera,
                                  depth.depth_unit_m, settings.refine.stride_px);
            for (Point& p : points) p = second_to_first().apply(p);
        }
        RegistrationOptions options = settings.refine;
        options.depth_noise_per_m = settings.lift.depth_noise_per_m;
        return refine_on_surface(case_.mesh, points, *camera_to_case(), options, {dots, markers});
    }

    void publish_registration(const Result<Registration>& found) {
        registration_t m{};
        m.header.capture_stamp_us = first_->header.capture_stamp_us;
        m.header.sequence = registration_sequence_++;
        m.header.frame_id = case_.name;
        m.camera = first_->check.info()->frame_id;
        m.good = static_cast<std::int8_t>(found.has_value());
        if (!found) m.reason = found.error().text;
        const Pose pose = found ? found->camera_to_case : *camera_to_case();
        std::copy(pose.R.begin(), pose.R.end(), std::begin(m.rotation));
        std::copy(pose.t.begin(), pose.t.end(), std::begin(m.translation_m));
        if (found) {
            for (int i = 0; i < 36; ++i) m.covariance[i] = found->covariance(i / 6, i % 6);
            for (int a = 0; a < 3; ++a) m.about_m[a] = found->centroid[a];
            m.rms_m = found->rms_m;
            m.points = static_cast<std::int32_t>(found->points);
            m.markers = static_cast<std::int32_t>(found->markers);
        }
        host_.publish("REGISTRATION", m);
    }

    void find_dots(const Stream& stream, std::vector<Blob>& dots) const {
        const CameraModel& camera = stream.check.info()->camera;
        const BlobOptions options{settings.tracker.bright,
                                  settings.tracker.diameter_m * camera.fx_px / tracker_->mean_z_m(),
                                  settings.tracker.contrast};
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

    bool publishes_now() {
        if (first_->header.capture_stamp_us < next_publish_us_) return false;
        next_publish_us_ = first_->header.capture_stamp_us + std::llround(1e6 * settings.publish_period_s) - 1;
        return true;
    }

    void publish_surface() {
        if (!sampler_ && !texture_) return;
        surface_ = {};
        surface_.header.capture_stamp_us = first_->header.capture_stamp_us;
        surface_.header.sequence = surface_sequence_++;
        surface_.header.frame_id = case_.name;
        if (texture_) add_features();
        if (sampler_) add_surface();
        surface_.num_points = static_cast<std::int32_t>(surface_.x_m.size());
        host_.publish("SURFACE_POINTS", surface_);
    }

    void add_features() {
        std::int32_t id = 0;
        for (const Feature& f : texture_->features()) {
            const Eigen::Vector3d x = f.sight.seen() ? f.sight.x : Eigen::Vector3d::Constant(kNaN);
            add_surface_point(id++, {x.x(), x.y(), x.z()}, std::sqrt(f.sight.covariance.trace() / 3.0),
                              {f.rest.x(), f.rest.y(), f.rest.z()});
        }
    }

    void add_surface() {
        const StreamInfo& depth = *second_->check.info();
        const Pose to_case = *camera_to_case() * second_to_first();
        for (const SurfaceSample& sample :
             sampler_->sample(liver_, *second_->image, depth.depth_unit_m, depth.camera, to_case,
                              settings.surface_points, settings.surface_gate_m, settings.lift))
            add_surface_point(-1, to_case.apply({sample.x.x(), sample.x.y(), sample.x.z()}), sample.sigma_m,
                              {kNaN, kNaN, kNaN});
    }

    void add_surface_point(std::int32_t feature, const Point& x, double sigma_m, const Point& rest) {
        const double pose = registration_ ? covariance_at(*registration_, {x[0], x[1], x[2]}).trace() / 3.0 : 0.0;
        surface_.feature_id.push_back(feature);
        surface_.x_m.push_back(x[0]);
        surface_.y_m.push_back(x[1]);
        surface_.z_m.push_back(x[2]);
        surface_.sigma_m.push_back(settings.sigma_factor * std::sqrt(sigma_m * sigma_m + pose));
        surface_.rest_x_m.push_back(rest[0]);
        surface_.rest_y_m.push_back(rest[1]);
        surface_.rest_z_m.push_back(rest[2]);
    }

    void publish_markers(const std::vector<MarkerSight>& sights) {
        const std::size_t count = sights.size();
        markers_.header.capture_stamp_us = first_->header.capture_stamp_us;
        markers_.header.sequence = sequence_++;
        markers_.header.frame_id = case_.name;
        markers_.num_markers = static_cast<std::int32_t>(count);
        markers_.marker_id.resize(count);
        for (auto* axis : {&markers_.x_m, &markers_.y_m, &markers_.z_m}) axis->assign(count, kNaN);
        markers_.sigma_m.assign(count, 0.0);
        for (std::size_t i = 0; i < count; ++i) {
            markers_.marker_id[i] = case_.markers[i].id;
            if (!sights[i].seen()) continue;
            markers_.x_m[i] = sights[i].x.x();
            markers_.y_m[i] = sights[i].x.y();
            markers_.z_m[i] = sights[i].x.z();
            Eigen::Matrix3d covariance = sights[i].covariance;
            if (registration_) covariance += covariance_at(*registration_, sights[i].x);
            markers_.sigma_m[i] = settings.sigma_factor * std::sqrt(covariance.trace() / 3.0);
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
    std::unique_ptr<SurfaceSampler> sampler_;
    std::unique_ptr<TextureTracker> texture_;
    std::vector<Point> liver_;  // nodes as predicted, case axes
    surface_points_t surface_{};
    std::int64_t surface_sequence_ = 0;
    std::vector<Landmark> landmarks_;
    std::optional<Pose> start_;  // from them
    std::optional<Registration> registration_;
    std::int64_t next_attempt_us_ = 0, last_seen_us_ = 0, registration_sequence_ = 0;
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
