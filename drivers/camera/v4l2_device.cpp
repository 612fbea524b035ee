#include "drivers/camera/v4l2_device.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace teres {
namespace {

constexpr std::uint32_t kNumBuffers = 4;
constexpr std::size_t kPage = 4096;
constexpr std::size_t kMaxFrameBytes = std::size_t{64} << 20;
constexpr int kMaxPixels = 16384;  // per side

bool is_gone(int error) {
    return error == ENODEV || error == ENXIO || error == ESHUTDOWN;
}

// Bytes per pixel of the packed formats that are passed on; 0: compressed or not known to be packed.
int bytes_per_pixel(std::uint32_t fourcc) {
    switch (fourcc) {
        case V4L2_PIX_FMT_GREY:
            return 1;
        case V4L2_PIX_FMT_YUYV:
        case V4L2_PIX_FMT_UYVY:
        case V4L2_PIX_FMT_Z16:
        case V4L2_PIX_FMT_Y16:
            return 2;
        case V4L2_PIX_FMT_RGB24:
        case V4L2_PIX_FMT_BGR24:
            return 3;
    }
    return 0;
}

bool is_compressed(std::uint32_t fourcc) {
    return fourcc == V4L2_PIX_FMT_MJPEG || fourcc == V4L2_PIX_FMT_JPEG || fourcc == V4L2_PIX_FMT_H264;
}

// "Exposure Time, Absolute" -> exposure_time_absolute, as v4l2-ctl does
std::string control_name(const std::uint8_t* text, std::size_t size) {
    std::string name;
    for (std::size_t i = 0; i < size && text[i] != 0; ++i) {
        if (std::isalnum(text[i]) != 0)
            name += static_cast<char>(std::tolower(text[i]));
        else if (!name.empty() && name.back() != '_')
            name += '_';
    }
    while (!name.empty() && name.back() == '_') name.pop_back();
    return name;
}

std::string size_text(int width_px, int height_px) {
    return std::to_string(width_px) + "x" + std::to_string(height_px);
}

}  // namespace

std::uint32_t fourcc_of(const std::string& text) {
    if (text.empty() || text.size() > 4) return 0;
    std::array<std::uint32_t, 4> letters{' ', ' ', ' ', ' '};
    for (std::size_t i = 0; i < text.size(); ++i) letters[i] = static_cast<unsigned char>(text[i]);
    return letters[0] | letters[1] << 8 | letters[2] << 16 | letters[3] << 24;
}

std::string fourcc_text(std::uint32_t fourcc) {
    std::string text;
    for (int shift = 0; shift < 32; shift += 8) {
        const auto letter = static_cast<char>(fourcc >> shift & 0x7f);
        text += std::isprint(static_cast<unsigned char>(letter)) != 0 ? letter : '?';
    }
    return text;
}

V4l2Device::V4l2Device(V4l2Device&& other) noexcept
    : calls_(other.calls_),
      fd_(std::exchange(other.fd_, -1)),
      node_(std::move(other.node_)),
      request_(other.request_),
      format_(other.format_),
      can_stream_(other.can_stream_),
      can_read_(other.can_read_) {}  // only between open and start: no buffers yet

V4l2Device::~V4l2Device() {
    if (fd_ < 0) return;
    stop();
    calls_->close(fd_);
}

int V4l2Device::control(unsigned long request, void* argument) {
    int result = 0;
    do result = calls_->ioctl(fd_, request, argument);
    while (result < 0 && errno == EINTR);
    return result;
}

tl::unexpected<Error> V4l2Device::failed(const std::string& what) const {
    const int error = errno;
    const std::string hint = error == EBUSY    ? "; another program uses the camera"
                             : error == EACCES ? "; the user must be in the group video"
                                               : "";
    const std::string text = node_.string() + ": " + what + ": " + std::strerror(error) + hint;
    return hint.empty() ? host_fault(text) : not_usable(text);
}

Result<V4l2Device> V4l2Device::open(SystemCalls& calls, const std::filesystem::path& node,
                                    const CaptureRequest& request) {
    V4l2Device device(calls, calls.open(node.c_str(), O_RDWR | O_NONBLOCK), node);
    if (device.fd_ < 0) return device.failed("open");
    device.request_ = request;
    v4l2_capability capability{};
    if (device.control(VIDIOC_QUERYCAP, &capability) < 0) return device.failed("VIDIOC_QUERYCAP");
    const std::uint32_t can =
        (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps : capability.capabilities;
    if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0) return invalid_input(node.string() + ": does not capture video");
    device.can_stream_ = (can & V4L2_CAP_STREAMING) != 0;
    device.can_read_ = (can & V4L2_CAP_READWRITE) != 0;
    TERES_TRY(device.negotiate(request));
    TERES_TRY(device.set_rate(request.rate_hz));
    return device;
}

Status V4l2Device::negotiate(const CaptureRequest& request) {
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    v4l2_pix_format& pixels = format.fmt.pix;
    pixels.width = static_cast<std::uint32_t>(request.width_px);
    pixels.height = static_cast<std::uint32_t>(request.height_px);
    pixels.pixelformat = request.fourcc;
    pixels.field = V4L2_FIELD_NONE;
    if (control(VIDIOC_S_FMT, &format) < 0) return failed("VIDIOC_S_FMT");
    const std::string wanted = fourcc_text(request.fourcc) + " " + size_text(request.width_px, request.height_px);
    if (pixels.width > kMaxPixels || pixels.height > kMaxPixels)
        return host_fault(node_.string() + ": the driver answers with an impossible size");
    format_.fourcc = pixels.pixelformat;
    format_.width_px = static_cast<int>(pixels.width);
    format_.height_px = static_cast<int>(pixels.height);
    if (format_.fourcc != request.fourcc || format_.width_px != request.width_px ||
        format_.height_px != request.height_px)
        return invalid_input(node_.string() + ": " + wanted + " not offered; the driver gives " +
                             fourcc_text(format_.fourcc) + " " + size_text(format_.width_px, format_.height_px));
    if (is_compressed(format_.fourcc)) {
        format_.frame_bytes = pixels.sizeimage;
    } else {
        const int depth = bytes_per_pixel(format_.fourcc);
        if (depth == 0) return invalid_input(node_.string() + ": format " + wanted + " is not supported here");
        const int least = depth * format_.width_px;
        format_.row_stride_bytes = std::max(static_cast<int>(pixels.bytesperline), least);
        if (format_.row_stride_bytes > 4 * kMaxPixels)
            return host_fault(node_.string() + ": the driver answers with an impossible row length");
        format_.frame_bytes =
            static_cast<std::size_t>(format_.row_stride_bytes) * static_cast<std::size_t>(format_.height_px);
        if (pixels.sizeimage < format_.frame_bytes)
            return host_fault(node_.string() + ": " + wanted + ": the driver's image size " +
                              std::to_string(pixels.sizeimage) + " is below " + std::to_string(format_.frame_bytes));
    }
    if (format_.frame_bytes == 0 || format_.frame_bytes > kMaxFrameBytes)
        return host_fault(node_.string() + ": frames of " + std::to_string(format_.frame_bytes) +
                          " bytes are out of [1, " + std::to_string(kMaxFrameBytes) + "]");
    return {};
}

Status V4l2Device::set_rate(double rate_hz) {
    v4l2_streamparm stream{};
    stream.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    v4l2_fract& frame_time = stream.parm.capture.timeperframe;
    frame_time = {1000, static_cast<std::uint32_t>(std::lround(rate_hz * 1000.0))};
    const bool asked = rate_hz > 0.0;
    if (control(asked ? VIDIOC_S_PARM : VIDIOC_G_PARM, &stream) < 0) {
        if (errno == ENOTTY || errno == EINVAL) return {};  // the node has no say in it
        return failed("VIDIOC_S_PARM");
    }
    if (frame_time.numerator > 0) format_.rate_hz = static_cast<double>(frame_time.denominator) / frame_time.numerator;
    return {};
}

Status V4l2Device::start() {
    struct Way {
        BufferMethod method;
        bool possible;
    };
    const Way ways[] = {{BufferMethod::kMmap, request_.try_mmap && can_stream_},
                        {BufferMethod::kUserptr, request_.try_userptr && can_stream_},
                        {BufferMethod::kRead, request_.try_read && can_read_}};
    bool ready = false;
    for (const Way& way : ways) {
        if (!way.possible) continue;
        TERES_TRY_ASSIGN(ready, request_buffers(way.method));
        if (!ready) continue;
        method_ = way.method;
        break;
    }
    if (!ready) return host_fault(node_.string() + ": offers neither MMAP nor USERPTR buffers nor read()");
    device_sequence_ = -1;
    if (method_ == BufferMethod::kRead) return {};
    for (std::uint32_t i = 0; i < buffers_.size(); ++i)
        if (!queue(i)) return failed("VIDIOC_QBUF");
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (control(VIDIOC_STREAMON, &type) < 0) return failed("VIDIOC_STREAMON");
    streaming_ = true;
    return {};
}

// False: the node cannot do it this way.
Result<bool> V4l2Device::request_buffers(BufferMethod method) {
    if (method == BufferMethod::kRead) {
        buffers_.clear();
        return true;
    }
    v4l2_requestbuffers wanted{};
    wanted.count = kNumBuffers;
    wanted.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    wanted.memory = method == BufferMethod::kMmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR;
    if (control(VIDIOC_REQBUFS, &wanted) < 0) {
        if (errno == EINVAL || errno == ENOTTY) return false;
        return failed("VIDIOC_REQBUFS");
    }
    method_ = method;
    const std::uint32_t count = std::min<std::uint32_t>(wanted.count, VIDEO_MAX_FRAME);
    bool usable = count >= 2;  // with one buffer every second frame is lost
    for (std::uint32_t i = 0; i < count && usable; ++i) {
        Buffer buffer;
        if (method == BufferMethod::kMmap) {
            v4l2_buffer query{};
            query.index = i;
            query.type = wanted.type;
            query.memory = wanted.memory;
            if (control(VIDIOC_QUERYBUF, &query) < 0) return failed("VIDIOC_QUERYBUF");
            void* address = calls_->mmap(query.length, fd_, query.m.offset);
            usable = address != MAP_FAILED && query.length <= 2 * kMaxFrameBytes;
            if (address != MAP_FAILED) buffers_.push_back({address, query.length});
        } else {
            const std::size_t length = (format_.frame_bytes + kPage - 1) / kPage * kPage;
            buffer = {std::aligned_alloc(kPage, length), length};
            usable = buffer.address != nullptr;
            if (usable) std::memset(buffer.address, 0, length);
            if (usable) buffers_.push_back(buffer);
        }
    }
    if (!usable) release_buffers();
    return usable;
}

bool V4l2Device::queue(std::uint32_t index) {
    v4l2_buffer buffer{};
    buffer.index = index;
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = method_ == BufferMethod::kMmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR;
    if (method_ == BufferMethod::kUserptr) {
        buffer.m.userptr = reinterpret_cast<unsigned long>(buffers_[index].address);
        buffer.length = static_cast<std::uint32_t>(buffers_[index].length);
    }
    return control(VIDIOC_QBUF, &buffer) >= 0;
}

void V4l2Device::stop() noexcept {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (streaming_) control(VIDIOC_STREAMOFF, &type);  // gives every buffer back; fails only if the device is gone
    streaming_ = false;
    release_buffers();
}

void V4l2Device::release_buffers() noexcept {
    if (buffers_.empty()) return;
    for (const Buffer& buffer : buffers_) {
        if (method_ == BufferMethod::kMmap)
            calls_->munmap(buffer.address, buffer.length);
        else
            std::free(buffer.address);
    }
    buffers_.clear();
    v4l2_requestbuffers none{};
    none.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    none.memory = method_ == BufferMethod::kMmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR;
    control(VIDIOC_REQBUFS, &none);
}

V4l2Device::Outcome V4l2Device::gone_or_failed(const char* what) {
    const int error = errno;
    fault_ = std::string(what) + ": " + std::strerror(error);
    return is_gone(error) ? Outcome::kGone : Outcome::kFailed;
}

V4l2Device::Outcome V4l2Device::next(Frame& to, int timeout_ms) {
    const int ready = calls_->poll(fd_, /*POLLIN*/ 1, timeout_ms);
    if (ready == 0 || (ready < 0 && errno == EINTR)) return Outcome::kNone;
    if (ready < 0) return gone_or_failed("poll");
    return method_ == BufferMethod::kRead ? next_by_read(to) : next_from_queue(to);
}

V4l2Device::Outcome V4l2Device::next_by_read(Frame& to) {
    to.data.resize(format_.frame_bytes);
    const ssize_t size = calls_->read(fd_, to.data.data(), to.data.size());
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return Outcome::kNone;
    if (size < 0) return gone_or_failed("read");
    to.data.resize(static_cast<std::size_t>(size));
    stamps_on_arrival_ = true;  // read() tells neither stamp nor sequence
    return accept(to, static_cast<std::uint32_t>(device_sequence_ + 1), calls_->now_us());
}

V4l2Device::Outcome V4l2Device::next_from_queue(Frame& to) {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = method_ == BufferMethod::kMmap ? V4L2_MEMORY_MMAP : V4L2_MEMORY_USERPTR;
    if (control(VIDIOC_DQBUF, &buffer) < 0) {
        if (errno == EAGAIN) return Outcome::kNone;
        return gone_or_failed("VIDIOC_DQBUF");
    }
    if (buffer.index >= buffers_.size()) {
        fault_ = "the driver gave a buffer that does not exist";
        return Outcome::kFailed;
    }
    const Buffer& memory = buffers_[buffer.index];
    const std::size_t size = std::min<std::size_t>(buffer.bytesused, memory.length);
    const auto* bytes = static_cast<const std::uint8_t*>(memory.address);
    to.data.assign(bytes, bytes + std::min(size, format_.frame_bytes));
    const bool flagged = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
    stamps_on_arrival_ = (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    const std::int64_t stamp_us = stamps_on_arrival_
                                      ? calls_->now_us()
                                      : buffer.timestamp.tv_sec * std::int64_t{1'000'000} + buffer.timestamp.tv_usec;
    if (!queue(buffer.index)) return gone_or_failed("VIDIOC_QBUF");
    if (flagged) {
        fault_ = "frame flagged as damaged by the driver";
        return Outcome::kDamaged;
    }
    return accept(to, buffer.sequence, stamp_us);
}

// Is it whole, and is it new?
V4l2Device::Outcome V4l2Device::accept(Frame& to, std::uint32_t device_sequence, std::int64_t capture_us) {
    const bool packed = format_.row_stride_bytes > 0;
    if (to.data.empty() || (packed && to.data.size() < format_.frame_bytes)) {
        fault_ =
            "short frame: " + std::to_string(to.data.size()) + " of " + std::to_string(format_.frame_bytes) + " bytes";
        return Outcome::kDamaged;
    }
    // Modulo 2^32; a step back or none is an old frame.
    const std::uint32_t ahead =
        device_sequence_ < 0 ? 1u : device_sequence - static_cast<std::uint32_t>(device_sequence_);
    if (ahead == 0 || ahead > 0x7fffffffu || capture_us <= newest_us_) {
        fault_ = "repeated or out-of-order frame";
        return Outcome::kDamaged;
    }
    if (capture_us > calls_->now_us() + 1'000'000) {
        fault_ = "frame stamped in the future";
        return Outcome::kDamaged;
    }
    lost_ += ahead - 1;
    sequence_ += ahead;
    device_sequence_ = device_sequence;
    newest_us_ = capture_us;
    to.capture_us = capture_us;
    to.sequence = sequence_;
    return Outcome::kFrame;
}

Status V4l2Device::set_control(const std::string& name, std::int64_t value) {
    std::string known;
    v4l2_queryctrl query{};
    query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    for (int count = 0; count < 1000 && control(VIDIOC_QUERYCTRL, &query) >= 0; ++count) {
        const std::string here = control_name(query.name, sizeof query.name);
        const bool usable = (query.flags & V4L2_CTRL_FLAG_DISABLED) == 0 && query.type != V4L2_CTRL_TYPE_CTRL_CLASS;
        if (usable && here == name) {
            const std::string place = node_.string() + ": control " + name;
            if ((query.flags & V4L2_CTRL_FLAG_READ_ONLY) != 0) return invalid_input(place + " can only be read");
            if (value < query.minimum || value > query.maximum)
                return invalid_input(place + " = " + std::to_string(value) + " is out of [" +
                                     std::to_string(query.minimum) + ", " + std::to_string(query.maximum) + "]");
            v4l2_control set{query.id, static_cast<std::int32_t>(value)};
            if (control(VIDIOC_S_CTRL, &set) < 0) return failed("control " + name);
            v4l2_control got{query.id, 0};
            if (control(VIDIOC_G_CTRL, &got) >= 0 && std::abs(got.value - value) > std::max(query.step - 1, 0))
                return not_usable(place + " = " + std::to_string(value) + " was not taken over: it is " +
                                  std::to_string(got.value));
            return {};
        }
        if (usable) known += (known.empty() ? "" : ", ") + here;
        query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    return invalid_input(node_.string() + ": no control " + name + "; there are: " + known);
}

}  // namespace teres
