// One stream of one camera, from finding the device to frames, with its recovery. pass() runs on a thread of its own
// and may be held up by the kernel; the loop's side (take, report) never waits for it.
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "drivers/camera/realsense.h"
#include "drivers/camera/v4l2_device.h"
#include "drivers/device/device_report.h"
#include "drivers/device/device_watch.h"
#include "drivers/device/usb_tree.h"
#include "teres/camera_info_t.hpp"

namespace teres {

struct StreamSettings {
    std::string device;  ///< serial number, or vendor:product
    CaptureRequest capture;
    std::vector<std::pair<std::string, std::int64_t>> controls;
    std::filesystem::path calibration_folder;
    DeviceWatch::Limits limits;
};

/// "gain=16, exposure_time_absolute=100". Error: names the part that is not NAME=INTEGER.
Result<std::vector<std::pair<std::string, std::int64_t>>> parse_controls(const std::string& text);

class CameraStream {
  public:
    CameraStream(SystemCalls& calls, DeviceRoots roots, StreamSettings settings);

    /// [capture thread] One step: look for the device, recover, or wait at most kWaitMs for a frame.
    void pass();
    static constexpr int kWaitMs = 50;

    /// [loop] The oldest waiting frame, each once. `to` gives its memory in exchange. False: none.
    bool take(Frame& to);
    /// [loop] As of now; a capture thread that is held up by the kernel shows as stale.
    DeviceReport report();
    const CaptureRequest& request() const { return settings_.capture; }
    /// [loop] Format and calibration of the stream; a new number whenever they were read anew.
    struct Info {
        int number = 0;
        CaptureFormat format;
        std::string serial;
        std::optional<camera_info_t> calibration;  ///< header empty
    };
    bool info_since(int number, Info& to);  ///< false: nothing newer than `number`

  private:
    void look_for_device(std::int64_t now_us);
    Result<VideoNode> find();
    Status open_device(const VideoNode& node);
    Status apply_controls();
    std::optional<camera_info_t> read_info(const VideoNode& node);
    std::optional<camera_info_t> realsense_info(RealSense& camera, const VideoNode& node);
    std::optional<int> open_control_node(const VideoNode& of);
    void recover(RecoveryStep step, std::int64_t now_us);
    void reset_device();
    void close_device();
    void frame_came(std::int64_t now_us);
    void read_temperature(std::int64_t now_us);
    void failed(const Error& error, std::int64_t now_us);
    void share();

    SystemCalls& calls_;
    const DeviceRoots roots_;
    const StreamSettings settings_;

    // Capture thread.
    DeviceWatch watch_;
    std::optional<V4l2Device> device_;
    VideoNode node_;
    int control_fd_ = -1;  // node of the extension unit, if not the device's own
    Frame frame_;
    std::string fault_, advice_;  // why there are no frames, what to do; empty while there are
    std::string warning_;         // of the open device: a slow link, a control refused, no calibration
    std::int64_t next_look_us_ = 0, next_temperature_us_ = 0;
    std::int64_t sequence_ = -1, newest_us_ = -1;
    std::int64_t received_ = 0, lost_before_ = 0, damaged_ = 0;
    double temperature_c_ = std::numeric_limits<double>::quiet_NaN();

    // Between the threads.
    static constexpr std::size_t kMaxWaiting = 4;
    std::mutex mutex_;
    std::deque<Frame> waiting_;
    std::vector<std::vector<std::uint8_t>> spare_;  // memory for the next frames
    std::int64_t overrun_ = 0;                      // frames that the loop did not take in time
    DeviceReport shared_;
    Info info_;
    std::atomic<std::int64_t> passed_us_{0};
};

}  // namespace teres
