// Unit `camera` (driver): up to four streams (colour, depth, left and right of a stereo pair), each with a capture
// thread of its own; the loop only hands finished frames on.
#include <chrono>
#include <memory>

#include "core/plugin_sdk.h"
#include "drivers/camera/camera_stream.h"
#include "drivers/device/device_report.h"
#include "drivers/device/device_thread.h"
#include "teres/image_t.hpp"

namespace teres {

// Settings of one stream, under keys that begin with its name.
struct StreamSection {
    std::string device;
    std::string format = "YUYV";
    int width_px = 640, height_px = 480;
    double rate_hz = 30.0;
    std::string controls;
};

struct CameraSettings {
    StreamSection color, depth{"", "Z16", 640, 480, 30.0, ""}, left, right;
    std::string buffers = "auto";
    std::filesystem::path calibration_folder;
    double stale_after_s = 0.25, step_after_s = 1.0, retry_after_s = 3.0;

    template <class V>
    void visit(V& field) {
#define TERES_STREAM(name, what)                                                                                 \
    field(#name "_device", name.device, "",                                                                      \
          what ": serial number, vendor:product as 8086:0b07, or name of a card; empty: none");                  \
    field(#name "_format", name.format, "", what ": V4L2 format, e.g. YUYV, UYVY, RGB3, BGR3, GREY, MJPG, Z16"); \
    field(#name "_width_px", name.width_px, {16, 8192}, what ": width");                                         \
    field(#name "_height_px", name.height_px, {16, 8192}, what ": height");                                      \
    field(#name "_rate_hz", name.rate_hz, {0.0, 240.0}, what ": frame rate; 0: what the device does");           \
    field(#name "_controls", name.controls, "", what ": V4L2 controls, as in gain=16, exposure_time_absolute=100");
        TERES_STREAM(color, "CAMERA_COLOR")
        TERES_STREAM(depth, "CAMERA_DEPTH")
        TERES_STREAM(left, "CAMERA_LEFT")
        TERES_STREAM(right, "CAMERA_RIGHT")
#undef TERES_STREAM
        field("buffers", buffers, "auto|mmap|userptr|read",
              "how frames come from the kernel; auto: the first that works");
        field("calibration_folder", calibration_folder,
              "<serial>.toml of cameras that do not know their own calibration; empty: none");
        field("stale_after_s", stale_after_s, {0.02, 60.0},
              "a stream silent for longer is stale; older frames are dropped");
        field("step_after_s", step_after_s, {0.05, 60.0},
              "time between restart of the stream, re-opening, reset of the device");
        field("retry_after_s", retry_after_s, {0.1, 600.0}, "time to the first frame, and between later attempts");
    }
};

class CameraDriver final : public Unit {
  public:
    using Settings = CameraSettings;
    Settings settings;

    explicit CameraDriver(Host host) : host_(std::move(host)) {}

    Status configure() override {
        lanes_.clear();
        TERES_TRY(add("color", "CAMERA_COLOR", settings.color));
        TERES_TRY(add("depth", "CAMERA_DEPTH", settings.depth));
        TERES_TRY(add("left", "CAMERA_LEFT", settings.left));
        TERES_TRY(add("right", "CAMERA_RIGHT", settings.right));
        if (lanes_.empty())
            return invalid_input(
                "camera: no device is named; `teres doctor` lists what is connected, e.g. "
                "camera.color_device = \"8086:0b07\"");
        return {};
    }

    Status start() override {
        for (Lane& lane : lanes_) lane.thread.emplace(lane.stream);
        return {};
    }

    teres_step_outcome step(std::int64_t) noexcept override try {
        const std::int64_t now_us = linux_calls().now_us();
        bool worked = false;
        for (Lane& lane : lanes_) {
            tell(lane, now_us);
            while (lane.stream->take(lane.frame)) {
                publish(lane);
                worked = true;
            }
        }
        return worked ? TERES_STEP_DONE : TERES_STEP_IDLE;
    } catch (...) {  // out of memory
        return TERES_STEP_DEGRADED;
    }

    void stop() override {
        for (Lane& lane : lanes_)
            if (lane.thread && !lane.thread->stop(std::chrono::seconds(2)))
                host_.log(TERES_LOG_WARN, "camera." + lane.name, "the kernel does not give the device back");
        for (Lane& lane : lanes_) lane.thread.reset();
    }

  private:
    static constexpr std::int64_t kReportEveryUs = 20'000, kInfoEveryUs = 1'000'000;

    struct Lane {
        std::string name, channel, info_channel;
        std::shared_ptr<CameraStream> stream;
        std::optional<DeviceThread> thread;
        DeviceReporter reporter;
        Frame frame;
        image_t image{};
        CameraStream::Info info{};
        std::int64_t info_sequence = 0;
        std::int64_t next_report_us = 0, next_info_us = 0;
    };

    Status add(const std::string& name, const std::string& channel, const StreamSection& section) {
        if (section.device.empty()) return {};
        StreamSettings stream;
        stream.device = section.device;
        stream.capture = {fourcc_of(section.format),
                          section.width_px,
                          section.height_px,
                          section.rate_hz,
                          settings.buffers == "auto" || settings.buffers == "mmap",
                          settings.buffers == "auto" || settings.buffers == "userptr",
                          settings.buffers == "auto" || settings.buffers == "read"};
        if (stream.capture.fourcc == 0)
            return invalid_input("camera." + name + "_format = '" + section.format + "' is not 1 to 4 letters");
        const auto controls = parse_controls(section.controls);
        if (!controls) return invalid_input("camera." + name + "_controls: " + controls.error().text);
        stream.controls = *controls;
        stream.calibration_folder = settings.calibration_folder;
        const auto us = [](double s) { return static_cast<std::int64_t>(1e6 * s); };
        stream.limits = {us(settings.stale_after_s), us(settings.step_after_s), us(settings.retry_after_s)};
        lanes_.push_back({name,
                          channel,
                          channel + "_INFO",
                          std::make_shared<CameraStream>(linux_calls(), DeviceRoots{}, stream),
                          std::nullopt,
                          DeviceReporter("camera." + name),
                          {},
                          {},
                          {}});
        return {};
    }

    void tell(Lane& lane, std::int64_t now_us) {
        if (now_us < lane.next_report_us) return;
        lane.next_report_us = now_us + kReportEveryUs;
        lane.reporter.tell(host_, lane.stream->report(), now_us);
        if (lane.stream->info_since(lane.info.number, lane.info)) lane.next_info_us = now_us;
        if (!lane.info.calibration || now_us < lane.next_info_us) return;
        lane.next_info_us = now_us + kInfoEveryUs;
        camera_info_t& info = *lane.info.calibration;
        info.header.capture_stamp_us = now_us;
        info.header.sequence = lane.info_sequence++;
        info.header.frame_id = "camera_" + lane.name;
        host_.publish(lane.info_channel.c_str(), info);
    }

    void publish(Lane& lane) {
        lane.stream->info_since(lane.info.number, lane.info);
        image_t& image = lane.image;
        image.header.capture_stamp_us = lane.frame.capture_us;
        image.header.sequence = lane.frame.sequence;
        image.header.frame_id = "camera_" + lane.name;
        image.serial = lane.info.serial;
        image.fourcc = fourcc_text(lane.info.format.fourcc);
        image.width_px = lane.info.format.width_px;
        image.height_px = lane.info.format.height_px;
        image.row_stride_bytes = lane.info.format.row_stride_bytes;
        image.num_bytes = static_cast<std::int32_t>(lane.frame.data.size());
        image.data.swap(lane.frame.data);
        host_.publish(lane.channel.c_str(), image);
        image.data.swap(lane.frame.data);
    }

    Host host_;
    std::vector<Lane> lanes_;
};

}  // namespace teres

TERES_PLUGIN(teres::CameraDriver, "camera", "V4L2 cameras: colour, depth (RealSense), stereo", TERES_UNIT_DRIVER)
