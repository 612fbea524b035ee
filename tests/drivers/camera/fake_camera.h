// A UVC camera behind the system-call table, on a clock of its own that runs only while somebody waits: a colour node
// and a depth node with RealSense's extension unit, one fault at a time.
#pragma once

#include <linux/usb/video.h>
#include <linux/usbdevice_fs.h>
#include <linux/uvcvideo.h>
#include <linux/videodev2.h>
#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "drivers/camera/realsense.h"
#include "drivers/camera/v4l2_device.h"
#include "drivers/device/usb_tree.h"
#include "tests/drivers/camera/realsense_tables.h"
#include "tests/support/test_data.h"

namespace teres::test {

class FakeCamera final : public SystemCalls {
  public:
    static constexpr int kWidth = 640, kHeight = 480;
    static constexpr std::size_t kFrameBytes = 2 * kWidth * kHeight;
    static constexpr std::int64_t kPeriodUs = 33'333;

    // Faults and properties.
    std::uint32_t fourcc = V4L2_PIX_FMT_Z16;  ///< the only one it has
    bool offers_mmap = true, offers_userptr = true, offers_read = true;
    std::map<unsigned long, std::deque<int>> errors;  ///< per request: errno of the next calls, 0 for none
    std::map<unsigned long, int> always;              ///< per request: errno of every call
    int open_error = 0, poll_error = 0, read_error = 0, mmap_error = 0;
    bool silent = false;                  ///< no frames
    bool gone = false;                    ///< every call on an open node: ENODEV
    std::deque<std::uint32_t> sequences;  ///< of the next frames, instead of counting up
    std::deque<std::int64_t> stamps;      ///< of the next frames
    std::deque<std::size_t> sizes;        ///< of the next frames
    std::deque<std::uint32_t> flags;      ///< of the next frames
    std::int64_t late_us = 0;             ///< frames wait so long before they come
    std::int32_t gain = 16;
    int gain_step = 1;
    bool gain_sticks = false;
    std::map<std::uint32_t, realsense::Bytes> tables;  ///< answers of the extension unit by opcode + 256 * parameter
    bool has_unit = false;
    bool resets_help = false;  ///< a reset ends `silent`
    // What it saw.
    int resets = 0, restarts = 0, opens = 0, open_nodes = 0, mappings = 0;
    std::int64_t clock_us = 1'000'000'000;

    FakeCamera() { plug("video0", "123456789abc"); }

    /// The camera's node in a made-up sysfs.
    void plug(const std::string& name, const std::string& serial, const std::string& speed = "5000") {
        const auto usb = scratch_.path() / "sys/devices/usb2/2-1";
        const auto node = usb / "2-1:1.0/video4linux" / name;
        std::filesystem::create_directories(node);
        const auto put = [&](const char* key, const std::string& value) { std::ofstream(usb / key) << value << "\n"; };
        put("serial", serial);
        put("idVendor", "8086");
        put("idProduct", "0b07");
        put("speed", speed);
        put("busnum", "2");
        put("devnum", "7");
        const auto klass = scratch_.path() / "sys/class/video4linux";
        std::filesystem::create_directories(klass);
        std::filesystem::create_directory_symlink(node, klass / name);
        gone = false;
    }
    void unplug() {
        std::filesystem::remove_all(scratch_.path() / "sys/class/video4linux");
        std::filesystem::remove_all(scratch_.path() / "sys/devices");
        gone = true;
    }
    DeviceRoots roots() const { return {scratch_.path() / "sys", scratch_.path() / "dev"}; }
    std::filesystem::path node() const { return roots().dev / "video0"; }
    std::filesystem::path scratch() const { return scratch_.path(); }

    int open(const char* path, int) override {
        if (std::string(path).find("bus/usb") != std::string::npos) {
            usb_path = path;
            return kUsbFd;
        }
        ++opens;
        if (open_error != 0) return fail(open_error);
        ++open_nodes;
        return kVideoFd;
    }
    int close(int fd) override {
        if (fd == kVideoFd) --open_nodes;
        return 0;
    }
    int ioctl(int fd, unsigned long request, void* argument) override {
        if (fd == kUsbFd) {
            reset();
            return 0;
        }
        if (gone) return fail(ENODEV);
        if (auto& next = errors[request]; !next.empty()) {
            const int error = next.front();
            next.pop_front();
            if (error != 0) return fail(error);
        }
        if (const auto it = always.find(request); it != always.end()) return fail(it->second);
        return answer(request, argument);
    }
    void* mmap(std::size_t length, int, std::int64_t offset) override {
        if (mmap_error != 0) {
            errno = mmap_error;
            return MAP_FAILED;
        }
        ++mappings;
        auto& memory = mapped_[static_cast<std::size_t>(offset) / kOffset];
        memory.resize(length);
        return memory.data();
    }
    int munmap(void*, std::size_t) override {
        --mappings;
        return 0;
    }
    int poll(int fd, short, int timeout_ms) override {
        if (fd < 0) {
            clock_us += 1000 * timeout_ms;
            return 0;
        }
        if (poll_error != 0) return fail(poll_error);
        if (gone) return 1;  // POLLERR
        const std::int64_t due_us = due();
        if (due_us < 0 || due_us > clock_us + 1000 * timeout_ms) {
            clock_us += 1000 * timeout_ms;
            return 0;
        }
        clock_us = std::max(clock_us, due_us);
        return 1;
    }
    ssize_t read(int, void* to, std::size_t size) override {
        if (read_error != 0) return fail(read_error);
        if (gone) return fail(ENODEV);
        reading_ = true;
        const std::size_t n = std::min(size, next_size());
        fill(to, n);
        next_frame_us_ = clock_us + kPeriodUs;
        ++sequence_;
        return static_cast<ssize_t>(n);
    }
    std::int64_t now_us() override { return clock_us; }

    std::string usb_path;

  private:
    static constexpr int kVideoFd = 10, kUsbFd = 11;
    static constexpr std::size_t kOffset = 0x100000;

    static int fail(int error) {
        errno = error;
        return -1;
    }
    template <class T>
    static T next_or(std::deque<T>& list, T otherwise) {
        if (list.empty()) return otherwise;
        const T value = list.front();
        list.pop_front();
        return value;
    }
    std::size_t next_size() { return next_or(sizes, kFrameBytes); }
    std::int64_t due() const {
        if (silent) return -1;
        if (!streaming_ && !reading_ && offers_mmap) return -1;
        return next_frame_us_ + late_us;
    }
    void reset() {
        ++resets;
        if (resets_help) silent = false;
    }
    void fill(void* to, std::size_t size) const {
        auto* pixels = static_cast<std::uint16_t*>(to);
        for (std::size_t i = 0; i < size / 2; ++i) pixels[i] = static_cast<std::uint16_t>(500 + sequence_ + i % kWidth);
    }

    int answer(unsigned long request, void* argument) {
        switch (request) {
            case VIDIOC_QUERYCAP: {
                auto& capability = *static_cast<v4l2_capability*>(argument);
                capability.device_caps = V4L2_CAP_VIDEO_CAPTURE;
                if (offers_mmap || offers_userptr) capability.device_caps |= V4L2_CAP_STREAMING;
                if (offers_read) capability.device_caps |= V4L2_CAP_READWRITE;
                capability.capabilities = capability.device_caps | V4L2_CAP_DEVICE_CAPS;
                return 0;
            }
            case VIDIOC_ENUM_FMT: {
                auto& format = *static_cast<v4l2_fmtdesc*>(argument);
                if (format.index > 0) return fail(EINVAL);
                format.pixelformat = fourcc;
                return 0;
            }
            case VIDIOC_S_FMT: {
                auto& pixels = static_cast<v4l2_format*>(argument)->fmt.pix;
                pixels.width = kWidth;
                pixels.height = kHeight;
                pixels.pixelformat = fourcc;
                pixels.bytesperline = 2 * kWidth;
                pixels.sizeimage = kFrameBytes;
                return 0;
            }
            case VIDIOC_S_PARM:
                static_cast<v4l2_streamparm*>(argument)->parm.capture.timeperframe = {1, 30};
                return 0;
            case VIDIOC_REQBUFS: {
                auto& wanted = *static_cast<v4l2_requestbuffers*>(argument);
                const bool can = wanted.memory == V4L2_MEMORY_MMAP ? offers_mmap : offers_userptr;
                if (!can) return fail(EINVAL);
                wanted.count = std::min(wanted.count, 4u);
                return 0;
            }
            case VIDIOC_QUERYBUF: {
                auto& buffer = *static_cast<v4l2_buffer*>(argument);
                buffer.length = kFrameBytes;
                buffer.m.offset = static_cast<std::uint32_t>(buffer.index * kOffset);
                return 0;
            }
            case VIDIOC_QBUF:
                queued_.push_back(*static_cast<v4l2_buffer*>(argument));
                return 0;
            case VIDIOC_STREAMON:
                ++restarts;
                streaming_ = true;
                sequence_ = 0;
                next_frame_us_ = clock_us + kPeriodUs;
                return 0;
            case VIDIOC_STREAMOFF:
                streaming_ = false;
                queued_.clear();
                return 0;
            case VIDIOC_DQBUF:
                return dequeue(*static_cast<v4l2_buffer*>(argument));
            case VIDIOC_QUERYCTRL: {
                auto& query = *static_cast<v4l2_queryctrl*>(argument);
                if (query.id != V4L2_CTRL_FLAG_NEXT_CTRL) return fail(EINVAL);
                query = {};
                query.id = V4L2_CID_GAIN;
                query.type = V4L2_CTRL_TYPE_INTEGER;
                std::strcpy(reinterpret_cast<char*>(query.name), "Gain, Analogue");
                query.minimum = 0;
                query.maximum = 128;
                query.step = gain_step;
                return 0;
            }
            case VIDIOC_S_CTRL:
                if (!gain_sticks) gain = static_cast<v4l2_control*>(argument)->value;
                return 0;
            case VIDIOC_G_CTRL:
                static_cast<v4l2_control*>(argument)->value = gain;
                return 0;
            case UVCIOC_CTRL_QUERY:
                return unit(*static_cast<uvc_xu_control_query*>(argument));
            default:
                return fail(ENOTTY);
        }
    }

    int dequeue(v4l2_buffer& buffer) {
        if (silent || queued_.empty() || clock_us < next_frame_us_) return fail(EAGAIN);
        const v4l2_buffer queued = queued_.front();
        queued_.pop_front();
        buffer = queued;
        const std::size_t size = next_size();
        buffer.bytesused = static_cast<std::uint32_t>(size);
        buffer.sequence = next_or(sequences, sequence_);
        buffer.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | next_or(flags, 0u);
        const std::int64_t stamp = next_or(stamps, next_frame_us_ - 10'000);
        buffer.timestamp = {stamp / 1'000'000, stamp % 1'000'000};
        void* memory = buffer.memory == V4L2_MEMORY_MMAP ? static_cast<void*>(mapped_[buffer.index].data())
                                                         : reinterpret_cast<void*>(buffer.m.userptr);
        fill(memory, std::min(size, kFrameBytes));
        sequence_ = buffer.sequence + 1;
        next_frame_us_ += kPeriodUs;
        return 0;
    }

    int unit(uvc_xu_control_query& query) {
        if (!has_unit || query.unit != 3) return fail(ENOENT);
        if (query.query == UVC_GET_LEN) {
            query.data[0] = realsense::kPacketBytes & 0xff;
            query.data[1] = realsense::kPacketBytes >> 8;
            return 0;
        }
        if (query.selector == 9) {
            const std::uint8_t temperature[4] = {1, 1, 41, 38};
            std::memcpy(query.data, temperature, 4);
            return 0;
        }
        if (query.query == UVC_SET_CUR) {
            command_.assign(query.data, query.data + query.size);
            if (command_[4] == realsense::kHardwareReset) reset();
            return 0;
        }
        std::uint32_t opcode = 0, parameter = 0;
        std::memcpy(&opcode, command_.data() + 4, 4);
        std::memcpy(&parameter, command_.data() + 8, 4);
        const realsense::Bytes& data = tables[opcode + 256 * parameter];
        std::memset(query.data, 0, query.size);
        const std::int32_t echo = data.empty() ? -6 : static_cast<std::int32_t>(opcode);
        std::memcpy(query.data, &echo, 4);
        std::copy(data.begin(), data.end(), query.data + 4);
        const auto size = static_cast<std::uint32_t>(data.size());
        std::memcpy(query.data + 1020, &size, 4);
        return 0;
    }

    ScratchFolder scratch_;
    std::map<std::size_t, std::vector<std::uint8_t>> mapped_;
    std::deque<v4l2_buffer> queued_;
    bool streaming_ = false, reading_ = false;
    std::uint32_t sequence_ = 0;
    std::int64_t next_frame_us_ = 0;
    realsense::Bytes command_;
};

/// Gives the fake RealSense's extension unit with all tables.
inline void make_realsense(FakeCamera& camera) {
    camera.has_unit = true;
    camera.tables[realsense::kIdentity] = identity_block();
    camera.tables[realsense::kCalibration + 256 * realsense::kDepthTable] = depth_table();
    camera.tables[realsense::kCalibration + 256 * realsense::kColorTable] = color_table();
    camera.tables[realsense::kAdvancedValue + 256 * realsense::kDepthControl] = depth_control(100);
}

}  // namespace teres::test
