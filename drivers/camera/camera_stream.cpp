#include "drivers/camera/camera_stream.h"

#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <charconv>

#include "drivers/camera/calibration_file.h"

namespace teres {
namespace {

constexpr std::int64_t kLookEveryUs = 200'000, kTemperatureEveryUs = 5'000'000;
constexpr const char* kRealSenseVendor = "8086:";
constexpr int kUsb2Mbps = 480;
constexpr double kUsb2UsableMbps = 280.0;  // what one camera gets through in practice

std::string trimmed(const std::string& text) {
    const auto first = text.find_first_not_of(" \t"), last = text.find_last_not_of(" \t");
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
}

bool offers(SystemCalls& calls, const std::filesystem::path& node, std::uint32_t fourcc) {
    const int fd = calls.open(node.c_str(), O_RDWR | O_NONBLOCK);
    if (fd < 0) return false;
    bool found = false;
    v4l2_fmtdesc format{};
    format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    for (; !found && format.index < 64 && calls.ioctl(fd, VIDIOC_ENUM_FMT, &format) >= 0; ++format.index)
        found = format.pixelformat == fourcc;
    calls.close(fd);
    return found;
}

}  // namespace

Result<std::vector<std::pair<std::string, std::int64_t>>> parse_controls(const std::string& text) {
    std::vector<std::pair<std::string, std::int64_t>> controls;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = std::min(text.find(',', at), text.size());
        const std::string part = trimmed(text.substr(at, end - at));
        at = end + 1;
        if (part.empty()) continue;
        const std::size_t equals = part.find('=');
        const std::string name = trimmed(part.substr(0, equals));
        const std::string number = equals == std::string::npos ? "" : trimmed(part.substr(equals + 1));
        std::int64_t value = 0;
        const auto read = std::from_chars(number.data(), number.data() + number.size(), value);
        if (name.empty() || read.ec != std::errc{} || read.ptr != number.data() + number.size() || value < INT32_MIN ||
            value > INT32_MAX)
            return invalid_input("control '" + part + "' is not NAME=INTEGER");
        controls.emplace_back(name, value);
    }
    return controls;
}

CameraStream::CameraStream(SystemCalls& calls, DeviceRoots roots, StreamSettings settings)
    : calls_(calls), roots_(std::move(roots)), settings_(std::move(settings)), watch_(settings_.limits) {}

void CameraStream::pass() {
    const std::int64_t now_us = calls_.now_us();
    passed_us_ = now_us;
    if (watch_.state() == DeviceState::kAbsent) {
        look_for_device(now_us);
        if (watch_.state() == DeviceState::kAbsent) calls_.poll(-1, 0, kWaitMs);
    } else if (const RecoveryStep step = watch_.due(now_us); step != RecoveryStep::kNone) {
        recover(step, now_us);
    } else if (!device_) {
        calls_.poll(-1, 0, kWaitMs);
    } else {
        switch (device_->next(frame_, kWaitMs)) {
            case V4l2Device::Outcome::kFrame:
                frame_came(calls_.now_us());
                break;
            case V4l2Device::Outcome::kNone:
                calls_.poll(-1, 0, 1);  // a node that is always ready must not keep the processor busy
                break;
            case V4l2Device::Outcome::kDamaged:
                ++damaged_;
                watch_.damaged(now_us);
                if (watch_.state() != DeviceState::kStreaming) fault_ = device_->fault();
                break;
            case V4l2Device::Outcome::kFailed:
                fault_ = device_->fault();
                watch_.error(now_us);
                calls_.poll(-1, 0, 5);  // a call that fails at once must not keep the processor busy
                break;
            case V4l2Device::Outcome::kGone:
                fault_ = "unplugged: " + device_->fault();
                close_device();
                watch_.gone();
                break;
        }
    }
    share();
}

void CameraStream::look_for_device(std::int64_t now_us) {
    if (now_us < next_look_us_) return;
    next_look_us_ = now_us + kLookEveryUs;
    const auto node = find();
    if (!node) {
        fault_ = node.error().text;
        if (node.error().kind == ErrorKind::kInvalidInput) watch_.refused(now_us);  // there, but not with this format
        return;
    }
    watch_.found(now_us);
    if (const Status opened = open_device(*node); !opened) failed(opened.error(), now_us);
}

void CameraStream::failed(const Error& error, std::int64_t now_us) {
    fault_ = error.text;
    close_device();
    if (error.kind == ErrorKind::kHostFault)
        watch_.error(now_us);
    else
        watch_.refused(now_us);
}

// By the serial number that USB tells, by vendor:product, or by the serial number that is printed on a RealSense.
Result<VideoNode> CameraStream::find() {
    const std::vector<VideoNode> nodes = video_nodes(roots_);
    const std::string& wanted = settings_.device;
    std::string there;
    bool named = false;
    for (const VideoNode& node : nodes) {
        const bool match = node.serial == wanted || node.id == wanted;
        named |= match;
        if (match && offers(calls_, node.node, settings_.capture.fourcc)) return node;
        there += (there.empty() ? "" : ", ") + node.node.filename().string() + " " + node.id +
                 (node.serial.empty() ? "" : " serial " + node.serial);
    }
    if (!named) {
        for (const VideoNode& node : nodes) {
            if (!node.id.starts_with(kRealSenseVendor) || !offers(calls_, node.node, settings_.capture.fourcc))
                continue;
            const auto fd = open_control_node(node);
            if (!fd) continue;
            auto camera = RealSense::attach(calls_, *fd);
            const auto identity = camera ? camera->identity() : tl::unexpected(camera.error());
            calls_.close(*fd);
            if (identity && (identity->serial == wanted || identity->asic_serial == wanted)) return node;
        }
    }
    if (named) return invalid_input("camera " + wanted + " offers no " + fourcc_text(settings_.capture.fourcc));
    return host_fault("camera " + wanted + " is not connected" +
                      (there.empty() ? "; there is no video device" : "; there are: " + there));
}

// First node of the same camera that has the extension unit; the caller closes it.
std::optional<int> CameraStream::open_control_node(const VideoNode& of) {
    for (const VideoNode& node : video_nodes(roots_)) {
        if (node.usb_device != of.usb_device || of.usb_device.empty()) continue;
        const int fd = calls_.open(node.node.c_str(), O_RDWR | O_NONBLOCK);
        if (fd < 0) continue;
        if (RealSense::attach(calls_, fd)) return fd;
        calls_.close(fd);
    }
    return std::nullopt;
}

Status CameraStream::open_device(const VideoNode& node) {
    close_device();
    node_ = node;
    TERES_TRY_ASSIGN(V4l2Device opened, V4l2Device::open(calls_, node.node, settings_.capture));
    device_.emplace(std::move(opened));
    device_->continue_after(sequence_, newest_us_);
    warning_.clear();
    if (node.id.starts_with(kRealSenseVendor))
        if (const auto fd = open_control_node(node)) control_fd_ = *fd;
    const auto calibration = read_info(node);
    if (const Status set = apply_controls(); !set) warning_ = set.error().text;  // other exposure is better than none
    TERES_TRY(device_->start());

    const CaptureFormat& format = device_->format();
    const double mbps = 8e-6 * static_cast<double>(format.frame_bytes) * format.rate_hz;
    const bool usb2 = node.usb_mbps > 0 && node.usb_mbps <= kUsb2Mbps;
    if (usb2 && (control_fd_ >= 0 || (format.row_stride_bytes > 0 && mbps > kUsb2UsableMbps)))
        warning_ = "on a USB 2 link (" + std::to_string(node.usb_mbps) +
                   " Mbit/s): frames will be lost or slow; use a USB 3 port and cable";
    else if (format.rate_hz > 0.0 && format.rate_hz < 0.95 * settings_.capture.rate_hz)
        warning_ =
            std::to_string(format.rate_hz) + " Hz offered, " + std::to_string(settings_.capture.rate_hz) + " asked";
    const std::lock_guard lock(mutex_);
    ++info_.number;
    info_.format = format;
    info_.serial = node.serial.empty() ? settings_.device : node.serial;
    info_.calibration = calibration;
    return {};
}

Status CameraStream::apply_controls() {
    Status first;
    for (const auto& [name, value] : settings_.controls)
        if (Status set = device_->set_control(name, value); !set && first) first = set;
    return first;
}

// From the device itself, else from the file of its serial number; what is wrong with them is told and nothing
// published.
std::optional<camera_info_t> CameraStream::read_info(const VideoNode& node) {
    if (control_fd_ >= 0) {
        if (auto camera = RealSense::attach(calls_, control_fd_)) {
            const auto identity = camera->identity();
            if (identity) node_.serial = identity->serial;
            return realsense_info(*camera, node);
        }
    }
    const CaptureRequest& capture = settings_.capture;
    auto read = read_calibration(settings_.calibration_folder, node.serial, capture.width_px, capture.height_px);
    if (!read) warning_ = read.error().text;
    return read ? *read : std::nullopt;
}

std::optional<camera_info_t> CameraStream::realsense_info(RealSense& camera, const VideoNode& node) {
    const CaptureRequest& capture = settings_.capture;
    camera_info_t info{};
    info.serial = node.serial;
    info.width_px = capture.width_px;
    info.height_px = capture.height_px;
    info.rotation[0] = info.rotation[4] = info.rotation[8] = 1.0;
    const auto fill = [&](const PinholeModel& model) {
        info.fx_px = model.fx_px;
        info.fy_px = model.fy_px;
        info.cx_px = model.cx_px;
        info.cy_px = model.cy_px;
        std::copy(model.distortion.begin(), model.distortion.end(), info.distortion);
    };
    const auto read = [&]() -> Status {
        if (capture.fourcc == V4L2_PIX_FMT_Z16) {
            TERES_TRY_ASSIGN(const PinholeModel model, camera.depth_model(capture.width_px, capture.height_px));
            TERES_TRY_ASSIGN(info.depth_unit_m, camera.depth_unit_m());
            TERES_TRY_ASSIGN(info.baseline_m, camera.baseline_m());
            fill(model);
        } else {
            TERES_TRY_ASSIGN(const ColorCalibration color, camera.color(capture.width_px, capture.height_px));
            fill(color.model);
            std::copy(color.pose.rotation.begin(), color.pose.rotation.end(), info.rotation);
            std::copy(color.pose.translation_m.begin(), color.pose.translation_m.end(), info.translation_m);
        }
        return {};
    };
    if (const Status done = read(); !done) {
        warning_ = done.error().text;
        return std::nullopt;
    }
    info.reference_frame = "camera_depth";
    return info;
}

void CameraStream::recover(RecoveryStep step, std::int64_t now_us) {
    const auto node = find();
    if (!node && node.error().kind == ErrorKind::kHostFault) {
        fault_ = node.error().text;
        close_device();
        watch_.gone();
        return;
    }
    if (!node) return failed(node.error(), now_us);
    if (fault_.empty()) fault_ = "no frames come";
    Status done;
    switch (step) {
        case RecoveryStep::kRestartStream:
            if (device_) device_->stop();
            done = device_ ? device_->start() : open_device(*node);
            break;
        case RecoveryStep::kReopen:
            done = open_device(*node);
            break;
        case RecoveryStep::kReset:
            reset_device();
            watch_.gone();  // until it is back
            break;
        case RecoveryStep::kAdvisePowerCycle:
            advice_ =
                "; no frames in spite of restart and reset: unplug the camera and plug it in again, on another port "
                "if it persists";
            break;
        case RecoveryStep::kNone:
            break;
    }
    if (!done) failed(done.error(), now_us);
}

// The camera leaves the bus and comes back: by its own command, else by the USB port.
void CameraStream::reset_device() {
    if (control_fd_ >= 0) {
        auto camera = RealSense::attach(calls_, control_fd_);
        const bool done = camera && camera->hardware_reset();
        close_device();
        if (done) return;
    }
    close_device();
    const int fd = calls_.open(node_.usb_node.c_str(), O_RDWR);
    if (fd < 0) return;
    calls_.ioctl(fd, USBDEVFS_RESET, nullptr);
    calls_.close(fd);
}

void CameraStream::close_device() {
    if (device_) {
        lost_before_ += device_->lost();
        device_.reset();
    }
    if (control_fd_ >= 0) calls_.close(control_fd_);
    control_fd_ = -1;
}

void CameraStream::frame_came(std::int64_t now_us) {
    sequence_ = frame_.sequence;
    newest_us_ = frame_.capture_us;
    if (now_us - frame_.capture_us > settings_.limits.stale_after_us) {
        ++damaged_;
        fault_ = "frames arrive late";
        return;
    }
    watch_.data(now_us);
    fault_.clear();
    advice_.clear();
    ++received_;
    read_temperature(now_us);
    const std::lock_guard lock(mutex_);
    if (waiting_.size() == kMaxWaiting) {
        ++overrun_;
        spare_.push_back(std::move(waiting_.front().data));
        waiting_.pop_front();
    }
    waiting_.push_back(std::move(frame_));
    frame_ = Frame{};
    if (!spare_.empty()) {
        frame_.data = std::move(spare_.back());
        spare_.pop_back();
    }
}

void CameraStream::read_temperature(std::int64_t now_us) {
    if (control_fd_ < 0 || now_us < next_temperature_us_) return;
    next_temperature_us_ = now_us + kTemperatureEveryUs;
    auto camera = RealSense::attach(calls_, control_fd_);
    const auto temperature = camera ? camera->temperature_c() : tl::unexpected(camera.error());
    temperature_c_ = temperature ? *temperature : std::numeric_limits<double>::quiet_NaN();
}

void CameraStream::share() {
    const std::lock_guard lock(mutex_);
    shared_.state = watch_.state();
    shared_.serial = watch_.state() == DeviceState::kAbsent ? settings_.device : node_.serial;
    shared_.node = watch_.state() == DeviceState::kAbsent ? "" : node_.node.string();
    shared_.detail = !fault_.empty() || !advice_.empty()      ? fault_ + advice_
                     : watch_.state() == DeviceState::kAbsent ? ""
                                                              : warning_;
    shared_.last_us = newest_us_ < 0 ? 0 : newest_us_;
    shared_.received = received_;
    shared_.lost = lost_before_ + (device_ ? device_->lost() : 0) + overrun_;
    shared_.damaged = damaged_;
    shared_.recoveries = watch_.recoveries();
    shared_.usb_mbps = watch_.state() == DeviceState::kAbsent ? 0 : node_.usb_mbps;
    shared_.temperature_c = temperature_c_;
}

bool CameraStream::take(Frame& to) {
    const std::int64_t oldest_us = calls_.now_us() - settings_.limits.stale_after_us;
    const std::lock_guard lock(mutex_);
    while (!waiting_.empty()) {
        if (spare_.size() < kMaxWaiting) spare_.push_back(std::move(to.data));
        to = std::move(waiting_.front());
        waiting_.pop_front();
        if (to.capture_us >= oldest_us) return true;
        ++overrun_;  // it waited too long to be passed on as new
    }
    return false;
}

DeviceReport CameraStream::report() {
    const std::int64_t held_us = calls_.now_us() - passed_us_;
    const std::lock_guard lock(mutex_);
    DeviceReport report = shared_;
    if (report.state == DeviceState::kStreaming && held_us > settings_.limits.stale_after_us) {
        report.state = DeviceState::kStale;
        report.detail = "the kernel holds up the capture";
    }
    return report;
}

bool CameraStream::info_since(int number, Info& to) {
    const std::lock_guard lock(mutex_);
    if (info_.number == number) return false;
    to = info_;
    return true;
}

}  // namespace teres
