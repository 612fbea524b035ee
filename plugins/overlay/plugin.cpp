// Unit `overlay`: CAMERA_COLOR (and _INFO), REGISTRATION, LIVER_STATE, BOUNDARY_ESTIMATE, MARKERS in; OVERLAY out, one
// augmented frame per colour frame, stamped as that frame.
#include <cmath>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/case/case_reader.h"
#include "core/plugin_sdk.h"
#include "plugins/overlay/overlay.h"
#include "teres/boundary_estimate_t.hpp"
#include "teres/camera_info_t.hpp"
#include "teres/image_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/registration_t.hpp"

namespace teres {
namespace {

constexpr std::size_t kMaxImageBytes = 32 << 20, kMaxMessageBytes = 8 << 20;

// Empty unless the bytes are an image of the stated size.
cv::Mat bgr_of(const image_t& m) {
    auto* data = const_cast<std::uint8_t*>(m.data.data());  // cv::Mat has no const view; only read
    const cv::Size size(m.width_px, m.height_px);
    cv::Mat image;
    if (m.fourcc == "MJPG") {
        if (!m.data.empty()) image = cv::imdecode(cv::Mat(1, m.num_bytes, CV_8U, data), cv::IMREAD_COLOR);
        return image.size() == size ? image : cv::Mat();
    }
    const int bytes = m.fourcc == "YUYV" ? 2 : m.fourcc == "GREY" ? 1 : 3;
    if (m.width_px <= 0 || m.height_px <= 0 || m.row_stride_bytes < std::int64_t{bytes} * m.width_px ||
        std::int64_t{m.row_stride_bytes} * m.height_px != m.num_bytes)
        return {};
    const cv::Mat view(size, CV_8UC(bytes), data, static_cast<std::size_t>(m.row_stride_bytes));
    if (m.fourcc == "BGR3") return view.clone();
    if (m.fourcc == "RGB3") cv::cvtColor(view, image, cv::COLOR_RGB2BGR);
    if (m.fourcc == "YUYV") cv::cvtColor(view, image, cv::COLOR_YUV2BGR_YUYV);
    if (m.fourcc == "GREY") cv::cvtColor(view, image, cv::COLOR_GRAY2BGR);
    return image;
}

}  // namespace

struct OverlaySettings {
    std::string case_folder;
    std::filesystem::path structures;
    OverlayOptions look;
    double point_radius_m = 0.003;
    double stale_after_s = 0.5;
    int jpeg_quality = 85;
    template <class V>
    void visit(V& field) {
        field("case", case_folder, "",
              "case folder (teres-case-1): mesh, camera pose, inner points; empty: that of [service]");
        field("structures", structures,
              "inner structures, CSV structure,x_m,y_m,z_m,radius_m at rest; empty: the case's validation points");
        field("liver_opacity", look.liver_opacity, {0.0, 1.0}, "of the surface");
        field("ligament_opacity", look.ligament_opacity, {0.0, 1.0}, "of the surface where the ligament surely holds");
        field("inner_opacity", look.inner_opacity, {0.0, 1.0}, "of an inner structure at the surface");
        field("fade_m", look.fade_m, {1e-4, 10.0}, "depth below the surface at which it has faded to 1/e");
        field("point_radius_m", point_radius_m, {1e-4, 0.1}, "of the case's points");
        field("stale_after_s", stale_after_s, {0.01, 3600.0}, "an older liver state is marked stale");
        field("jpeg_quality", jpeg_quality, {0.0, 100.0}, "of OVERLAY; 0: raw (BGR3)");
    }
};

class OverlayPlugin final : public Unit {
  public:
    using Settings = OverlaySettings;
    Settings settings;

    explicit OverlayPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override {
        if (settings.case_folder.empty()) return invalid_input("overlay.case (or service.case) names no case folder");
        CaseReadOptions reading;
        reading.observations = false;
        TERES_TRY_ASSIGN(case_, read_case(settings.case_folder, reading));
        std::vector<StructurePoint> structures;
        if (!settings.structures.empty()) {
            TERES_TRY_ASSIGN(structures, read_structures(settings.structures));
        } else {
            for (const MarkerRest& p : case_.validation_rest)
                structures.push_back({std::to_string(p.id), p.position_m, settings.point_radius_m});
        }
        overlay_ = std::make_unique<Overlay>(case_.mesh, std::move(structures), settings.look);
        return {};
    }

    Status start() override {
        sequence_ = 0;
        pending_ = false;
        camera_.reset();
        registered_.reset();
        state_us_.reset();
        TERES_TRY(host_.subscribe<camera_info_t>("CAMERA_COLOR_INFO", kMaxMessageBytes,
                                                 [this](const camera_info_t& m, std::int64_t) { take_info(m); }));
        TERES_TRY(host_.subscribe<image_t>("CAMERA_COLOR", kMaxImageBytes, [this](const image_t& m, std::int64_t) {
            frame_ = m;
            pending_ = true;
        }));
        TERES_TRY(host_.subscribe<liver_state_t>("LIVER_STATE", kMaxMessageBytes,
                                                 [this](const liver_state_t& m, std::int64_t) { take_state(m); }));
        TERES_TRY(host_.subscribe<boundary_estimate_t>(
            "BOUNDARY_ESTIMATE", kMaxMessageBytes, [this](const boundary_estimate_t& m, std::int64_t) {
                overlay_->set_attachment(m.node_id, m.attachment_probability);
            }));
        TERES_TRY(host_.subscribe<registration_t>(
            "REGISTRATION", kMaxMessageBytes, [this](const registration_t& m, std::int64_t) { take_registration(m); }));
        return host_.subscribe<markers_t>("MARKERS", kMaxMessageBytes, [this](const markers_t& m, std::int64_t) {
            std::vector<Point> markers;
            for (std::size_t i = 0; i < m.x_m.size(); ++i) markers.push_back({m.x_m[i], m.y_m[i], m.z_m[i]});
            overlay_->set_markers(std::move(markers));
        });
    }

    // Loads, markers and the estimate of a frame come behind the frame in the same turn: it is drawn one step later.
    teres_step_outcome step(std::int64_t) noexcept override try {
        if (!pending_) return TERES_STEP_IDLE;
        pending_ = false;
        cv::Mat image = bgr_of(frame_);
        if (image.empty() || !camera_ || image.size() != cv::Size(camera_->camera.width_px, camera_->camera.height_px))
            return TERES_STEP_DEGRADED;
        const bool stale = !state_us_ || state_stale_ ||
                           frame_.header.capture_stamp_us - *state_us_ > std::llround(1e6 * settings.stale_after_s);
        overlay_->draw(image, stale);
        publish(image);
        return stale ? TERES_STEP_DEGRADED : TERES_STEP_DONE;
    } catch (...) {  // OpenCV on hostile data, out of memory: this frame is lost
        return TERES_STEP_DEGRADED;
    }

  private:
    void take_info(const camera_info_t& message) {
        const auto info = stream_info(message);
        if (!info) return;
        const auto stated = info->reference_frame == case_.name ? info->to_reference : camera_pose(case_.sensor);
        if (!stated && !registered_) return;
        camera_ = *info;
        overlay_->set_camera(info->camera, registered_ ? *registered_ : *stated);
    }

    // Of another camera than the one that is drawn over: not used.
    void take_registration(const registration_t& m) {
        if (!camera_ || m.camera != camera_->frame_id || m.good == 0) return;
        registered_.emplace();
        std::copy(std::begin(m.rotation), std::end(m.rotation), registered_->R.begin());
        std::copy(std::begin(m.translation_m), std::end(m.translation_m), registered_->t.begin());
        overlay_->set_camera(camera_->camera, *registered_);
    }

    void take_state(const liver_state_t& m) {
        positions_.resize(m.x_m.size());
        for (std::size_t i = 0; i < positions_.size(); ++i) positions_[i] = {m.x_m[i], m.y_m[i], m.z_m[i]};
        overlay_->set_positions(positions_);
        state_us_ = m.header.capture_stamp_us;
        state_stale_ = m.stale != 0;
    }

    void publish(const cv::Mat& image) {
        out_.header.capture_stamp_us = frame_.header.capture_stamp_us;
        out_.header.sequence = sequence_++;
        out_.header.frame_id = frame_.header.frame_id;
        out_.serial = frame_.serial;
        out_.width_px = image.cols;
        out_.height_px = image.rows;
        if (settings.jpeg_quality > 0) {
            out_.fourcc = "MJPG";
            out_.row_stride_bytes = 0;
            cv::imencode(".jpg", image, out_.data, {cv::IMWRITE_JPEG_QUALITY, settings.jpeg_quality});
        } else {
            out_.fourcc = "BGR3";
            out_.row_stride_bytes = static_cast<std::int32_t>(image.step);
            out_.data.assign(image.data, image.data + image.total() * image.elemSize());
        }
        out_.num_bytes = static_cast<std::int32_t>(out_.data.size());
        host_.publish("OVERLAY", out_);
    }

    Host host_;
    Case case_;
    std::unique_ptr<Overlay> overlay_;
    std::optional<StreamInfo> camera_;
    std::optional<Pose> registered_;
    image_t frame_{}, out_{};
    bool pending_ = false, state_stale_ = false;
    std::optional<std::int64_t> state_us_;
    std::vector<Point> positions_;
    std::int64_t sequence_ = 0;
};

}  // namespace teres

TERES_PLUGIN(teres::OverlayPlugin, "overlay", "liver, ligament and inner structures over the colour image",
             TERES_UNIT_PLUGIN)
