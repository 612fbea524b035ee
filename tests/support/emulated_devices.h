// Devices for an unmodified program, by umockdev: a V4L2 depth camera with RealSense's extension unit and a USB
// footswitch. The test runs below umockdev-wrapper and starts the program as a child; faults are switched on from the
// test.
#pragma once

#include <linux/usb/video.h>
#include <linux/usbdevice_fs.h>
#include <linux/uvcvideo.h>
#include <linux/videodev2.h>
#include <umockdev.h>

#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <deque>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/clock.h"
#include "tests/drivers/camera/fake_camera.h"

namespace teres::test {

class EmulatedCamera {
  public:
    static constexpr int kWidth = 320, kHeight = 240;
    static constexpr std::size_t kFrameBytes = 2 * kWidth * kHeight;

    // Faults; what is counted down ends by itself.
    std::atomic<int> dequeue_errors{0}, dequeue_errno{EIO};
    std::atomic<int> short_frames{0}, skipped_frames{0}, flagged_frames{0}, repeated_frames{0};
    std::atomic<int> hang_ms{0};  ///< the next dequeue does not return for so long
    std::atomic<bool> silent{false}, busy{false};
    std::atomic<std::uint32_t> fourcc{V4L2_PIX_FMT_Z16};
    std::atomic<int> resets{0}, streams{0}, format_requests{0};
    std::atomic<std::uint32_t> memory{0};  ///< what the program asked for last; 0 with read()
    std::atomic<std::int64_t> frames{0};

    explicit EmulatedCamera(UMockdevTestbed* testbed, std::uint32_t methods = V4L2_MEMORY_MMAP)
        : testbed_(testbed), method_(methods) {
        tables_[realsense::kIdentity] = identity_block();
        auto depth = TableWriter(25, 512);
        depth.floats(160, {-50.0f}).floats(256 + 6 * 16, {193.0f, 193.5f, 160.5f, 119.5f});  // 320x240
        tables_[realsense::kCalibration] = depth.done();
        tables_[realsense::kAdvancedValue] = depth_control(500);
    }
    ~EmulatedCamera() {
        unplug();
        for (const auto& [node, base] : handlers_) {
            umockdev_testbed_detach_ioctl(testbed_, node.c_str(), nullptr);
            g_object_unref(base);
        }
    }

    void plug(const std::string& name, const std::string& serial) {
        const std::string usb = "/devices/pci0000:00/0000:00:14.0/usb2/2-1";
        usb_path_ = "/sys" + usb;
        node_ = "/dev/" + name;
        video_path_ = usb_path_ + "/2-1:1.0/video4linux/" + name;
        add("P: " + usb +
            "\nN: bus/usb/002/007\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: DEVNAME=/dev/bus/usb/002/007\n"
            "E: BUSNUM=002\nE: DEVNUM=007\nA: serial=" +
            serial +
            "\\n\nA: idVendor=8086\\n\nA: idProduct=0b07\\n\n"
            "A: speed=5000\\n\nA: busnum=2\\n\nA: devnum=7\\n\n");
        add("P: " + usb + "/2-1:1.0/video4linux/" + name + "\nN: " + name + "=00\nE: DEVNAME=" + node_ +
            "\nE: SUBSYSTEM=video4linux\nA: name=Emulated depth camera\\n\n");
        gchar* root = umockdev_testbed_get_root_dir(testbed_);
        backing_ = open((root + node_).c_str(), O_RDWR);
        g_free(root);
        gone_ = false;
        handle(node_, G_CALLBACK(&on_video), G_CALLBACK(&on_read));
        handle("/dev/bus/usb/002/007", G_CALLBACK(&on_usb), nullptr);
    }
    // Handlers stay: a program that still has the node open is told ENODEV, as by the kernel.
    void unplug() {
        if (backing_ < 0) return;
        gone_ = true;
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
        umockdev_testbed_remove_device(testbed_, video_path_.c_str());
        umockdev_testbed_remove_device(testbed_, usb_path_.c_str());
        close(backing_);
        backing_ = -1;
    }

  private:
    static constexpr std::size_t kOffset = 0x100000;
    static constexpr std::int64_t kPeriodUs = 33'333;
    using Ioctl = UMockdevIoctlClient;

    void add(const std::string& text) {
        GError* error = nullptr;
        umockdev_testbed_add_from_string(testbed_, text.c_str(), &error);
        EXPECT_EQ(error, nullptr) << error->message;
    }
    void handle(const std::string& node, GCallback on_ioctl, GCallback read) {
        if (handlers_.count(node) > 0) return;
        UMockdevIoctlBase* base = umockdev_ioctl_base_new();
        g_signal_connect(base, "handle-ioctl", on_ioctl, this);
        if (read != nullptr) g_signal_connect(base, "handle-read", read, this);
        GError* error = nullptr;
        umockdev_testbed_attach_ioctl(testbed_, node.c_str(), base, &error);
        EXPECT_EQ(error, nullptr) << error->message;
        handlers_[node] = base;
    }
    static bool take(std::atomic<int>& count) {
        int left = count;
        while (left > 0)
            if (count.compare_exchange_weak(left, left - 1)) return true;
        return false;
    }
    void fill(std::uint8_t* to, std::size_t size) const {
        for (std::size_t i = 0; i + 1 < size; i += 2) {
            const auto value = static_cast<std::uint16_t>(500 + sequence_ + i / 2 % kWidth);
            std::memcpy(to + i, &value, 2);
        }
    }

    static gboolean on_usb(UMockdevIoctlBase*, Ioctl* client, gpointer user) {
        auto& camera = *static_cast<EmulatedCamera*>(user);
        const bool reset = umockdev_ioctl_client_get_request(client) == USBDEVFS_RESET;
        if (reset) camera.reset();
        umockdev_ioctl_client_complete(client, reset ? 0 : -1, reset ? 0 : ENOTTY);
        return TRUE;
    }
    void reset() {
        ++resets;
        silent = false;
    }
    static gboolean on_read(UMockdevIoctlBase*, Ioctl* client, gpointer user) {
        auto& camera = *static_cast<EmulatedCamera*>(user);
        UMockdevIoctlData* to = umockdev_ioctl_client_get_arg(client);
        const std::int64_t now = monotonic_us();
        if (camera.gone_ || now < camera.next_us_) {
            umockdev_ioctl_client_complete(client, -1, camera.gone_ ? ENODEV : EAGAIN);
            return TRUE;
        }
        const auto size = std::min<std::size_t>(to->data_len, kFrameBytes);
        camera.fill(to->data, size);
        camera.next_us_ = now + kPeriodUs;
        ++camera.sequence_;
        ++camera.frames;
        umockdev_ioctl_client_complete(client, static_cast<glong>(size), 0);
        return TRUE;
    }
    static gboolean on_video(UMockdevIoctlBase*, Ioctl* client, gpointer user) {
        auto& camera = *static_cast<EmulatedCamera*>(user);
        const auto request = static_cast<unsigned>(umockdev_ioctl_client_get_request(client));
        UMockdevIoctlData* argument = umockdev_ioctl_client_get_arg(client);
        UMockdevIoctlData* data =
            _IOC_SIZE(request) > 0 ? umockdev_ioctl_data_resolve(argument, 0, _IOC_SIZE(request), nullptr) : nullptr;
        const int error = camera.gone_ ? ENODEV : camera.answer(request, data);
        umockdev_ioctl_client_complete(client, error == 0 ? 0 : -1, error);
        return TRUE;
    }

    // errno, 0 for success.
    int answer(unsigned request, UMockdevIoctlData* data) {
        void* p = data != nullptr ? data->data : nullptr;
        switch (request) {
            case VIDIOC_QUERYCAP: {
                auto& capability = *static_cast<v4l2_capability*>(p);
                capability = {};
                capability.device_caps = V4L2_CAP_VIDEO_CAPTURE;
                capability.device_caps |= method_ != 0 ? V4L2_CAP_STREAMING : V4L2_CAP_READWRITE;
                capability.capabilities = capability.device_caps | V4L2_CAP_DEVICE_CAPS;
                return 0;
            }
            case VIDIOC_ENUM_FMT: {
                auto& format = *static_cast<v4l2_fmtdesc*>(p);
                if (format.index > 0) return EINVAL;
                format.pixelformat = V4L2_PIX_FMT_Z16;
                return 0;
            }
            case VIDIOC_S_FMT: {
                ++format_requests;
                if (busy) return EBUSY;
                auto& pixels = static_cast<v4l2_format*>(p)->fmt.pix;
                pixels.width = kWidth;
                pixels.height = kHeight;
                pixels.pixelformat = fourcc;
                pixels.bytesperline = 2 * kWidth;
                pixels.sizeimage = kFrameBytes;
                return 0;
            }
            case VIDIOC_S_PARM:
                static_cast<v4l2_streamparm*>(p)->parm.capture.timeperframe = {1, 30};
                return 0;
            case VIDIOC_REQBUFS: {
                auto& wanted = *static_cast<v4l2_requestbuffers*>(p);
                if (wanted.memory != method_) return EINVAL;
                wanted.count = std::min(wanted.count, 4u);
                queued_.clear();
                if (wanted.count > 0) memory = wanted.memory;
                if (method_ == V4L2_MEMORY_MMAP && ftruncate(backing_, 4 * kOffset) != 0) return ENOMEM;
                return 0;
            }
            case VIDIOC_QUERYBUF: {
                auto& buffer = *static_cast<v4l2_buffer*>(p);
                buffer.length = kFrameBytes;
                buffer.m.offset = static_cast<std::uint32_t>(buffer.index * kOffset);
                return 0;
            }
            case VIDIOC_QBUF:
                queued_.push_back(*static_cast<v4l2_buffer*>(p));
                return 0;
            case VIDIOC_STREAMON:
                ++streams;
                sequence_ = 0;
                next_us_ = monotonic_us() + kPeriodUs;
                streaming_ = true;
                return 0;
            case VIDIOC_STREAMOFF:
                streaming_ = false;
                queued_.clear();
                return 0;
            case VIDIOC_DQBUF:
                return dequeue(data);
            case UVCIOC_CTRL_QUERY:
                return unit(data);
            default:
                return ENOTTY;
        }
    }

    int dequeue(UMockdevIoctlData* data) {
        if (const int ms = hang_ms.exchange(0); ms > 0) std::this_thread::sleep_for(std::chrono::milliseconds(ms));
        if (!streaming_) return EINVAL;
        if (take(dequeue_errors)) return dequeue_errno;
        const std::int64_t now = monotonic_us();
        if (silent || queued_.empty() || now < next_us_) return EAGAIN;
        const bool repeat = take(repeated_frames);
        if (take(skipped_frames)) ++sequence_;
        auto& buffer = *reinterpret_cast<v4l2_buffer*>(data->data);
        buffer = queued_.front();
        queued_.pop_front();
        const std::size_t size = take(short_frames) ? kFrameBytes / 2 : kFrameBytes;
        buffer.bytesused = static_cast<std::uint32_t>(size);
        buffer.sequence = repeat && sequence_ > 0 ? sequence_ - 1 : sequence_;
        buffer.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | (take(flagged_frames) ? V4L2_BUF_FLAG_ERROR : 0u);
        buffer.timestamp = {now / 1'000'000, now % 1'000'000};
        if (method_ == V4L2_MEMORY_MMAP) {
            std::vector<std::uint8_t> frame(kFrameBytes);
            fill(frame.data(), frame.size());
            if (pwrite(backing_, frame.data(), frame.size(), static_cast<off_t>(buffer.index * kOffset)) < 0)
                return EIO;
        } else {
            UMockdevIoctlData* memory_of_user =
                umockdev_ioctl_data_resolve(data, offsetof(v4l2_buffer, m.userptr), kFrameBytes, nullptr);
            if (memory_of_user == nullptr) return EFAULT;
            fill(memory_of_user->data, kFrameBytes);
        }
        if (!repeat) ++sequence_;
        ++frames;
        next_us_ = std::max(next_us_ + kPeriodUs, now - kPeriodUs);
        return 0;
    }

    int unit(UMockdevIoctlData* data) {
        auto& query = *reinterpret_cast<uvc_xu_control_query*>(data->data);
        if (query.unit != 3) return ENOENT;
        UMockdevIoctlData* bytes =
            umockdev_ioctl_data_resolve(data, offsetof(uvc_xu_control_query, data), query.size, nullptr);
        if (bytes == nullptr) return EFAULT;
        std::uint8_t* to = bytes->data;
        if (query.query == UVC_GET_LEN) {
            to[0] = realsense::kPacketBytes & 0xff;
            to[1] = realsense::kPacketBytes >> 8;
        } else if (query.selector == 9) {
            const std::uint8_t temperature[4] = {1, 1, 41, 38};
            std::memcpy(to, temperature, 4);
        } else if (query.query == UVC_SET_CUR) {
            std::memcpy(&opcode_, to + 4, 4);
            if (opcode_ == realsense::kHardwareReset) reset();
        } else {
            const realsense::Bytes& answer = tables_[opcode_];
            std::memset(to, 0, query.size);
            std::memcpy(to, &opcode_, 4);
            std::copy(answer.begin(), answer.end(), to + 4);
            const auto size = static_cast<std::uint32_t>(answer.size());
            std::memcpy(to + 1020, &size, 4);
        }
        return 0;
    }

    UMockdevTestbed* testbed_;
    std::uint32_t method_;  // 0: read()
    std::map<std::uint32_t, realsense::Bytes> tables_;
    std::string node_, usb_path_, video_path_;
    std::map<std::string, UMockdevIoctlBase*> handlers_;
    int backing_ = -1;
    std::atomic<bool> gone_{false};
    // Handler thread only.
    std::deque<v4l2_buffer> queued_;
    bool streaming_ = false;
    std::uint32_t sequence_ = 0, opcode_ = 0;
    std::int64_t next_us_ = 0;
};

/// VEC Infinity footswitch below usbfs.
class EmulatedFootswitch {
  public:
    explicit EmulatedFootswitch(UMockdevTestbed* testbed) : testbed_(testbed) {}
    ~EmulatedFootswitch() {
        unplug();
        if (base_ == nullptr) return;
        umockdev_testbed_detach_ioctl(testbed_, kNode, nullptr);
        g_object_unref(base_);
    }

    void plug() {
        // device, configuration, interface (HID), HID, interrupt endpoint 0x81 of 8 bytes
        const std::string descriptors =
            "12011001000000"
            "08F305FF00200101020001"
            "09022200010100"
            "8032"
            "090400000103000000"
            "092110010001221F00"
            "0705810308000A";
        const std::string text =
            "P: /devices/pci0000:00/0000:00:14.0/usb1/1-2\nN: bus/usb/001/004\nE: DEVNAME=/dev/bus/usb/001/004\n"
            "E: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: BUSNUM=001\nE: DEVNUM=004\nE: MAJOR=189\nE: MINOR=3\n"
            "E: PRODUCT=5f3/ff/120\nA: busnum=1\\n\nA: devnum=4\\n\nA: speed=12\\n\nA: bConfigurationValue=1\\n\n"
            "A: bNumConfigurations= 1\\n\nA: idVendor=05f3\\n\nA: idProduct=00ff\\n\nA: bNumInterfaces= 1\\n\n"
            "H: descriptors=" +
            descriptors + "\n";
        GError* error = nullptr;
        {
            const std::lock_guard lock(mutex_);
            gone_ = false;
            plugged_ = true;
            done_.clear();
        }
        umockdev_testbed_add_from_string(testbed_, text.c_str(), &error);
        EXPECT_EQ(error, nullptr) << error->message;
        if (base_ != nullptr) return;
        base_ = umockdev_ioctl_base_new();
        g_signal_connect(base_, "handle-ioctl", G_CALLBACK(&on_ioctl), this);
        umockdev_testbed_attach_ioctl(testbed_, kNode, base_, &error);
        EXPECT_EQ(error, nullptr) << error->message;
    }
    void unplug() {
        {
            const std::lock_guard lock(mutex_);
            if (!plugged_) return;
            plugged_ = false;
            gone_ = true;
            for (Urb& urb : pending_) done_.push_back({urb.data, -ESHUTDOWN});
            pending_.clear();
        }
        umockdev_testbed_uevent(testbed_, kPath, "remove");
        std::this_thread::sleep_for(std::chrono::milliseconds(300));  // the program reaps what is left
        umockdev_testbed_remove_device(testbed_, kPath);
    }
    /// False if the program does not listen.
    bool report(std::uint8_t mask) {
        const std::lock_guard lock(mutex_);
        if (pending_.empty()) return false;
        Urb urb = pending_.front();
        pending_.pop_front();
        auto* request = reinterpret_cast<usbdevfs_urb*>(urb.data->data);
        auto* bytes = static_cast<std::uint8_t*>(request->buffer);
        bytes[0] = mask;
        bytes[1] = 0;
        request->actual_length = 2;
        done_.push_back({urb.data, 0});
        return true;
    }

  private:
    static constexpr const char* kNode = "/dev/bus/usb/001/004";
    static constexpr const char* kPath = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-2";
    struct Urb {
        UMockdevIoctlData* data;
        int status;
    };

    static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer user) {
        auto& device = *static_cast<EmulatedFootswitch*>(user);
        const std::lock_guard lock(device.mutex_);
        const auto request = static_cast<unsigned>(umockdev_ioctl_client_get_request(client));
        const int error = device.answer(request, umockdev_ioctl_client_get_arg(client));
        umockdev_ioctl_client_complete(client, error == 0 ? 0 : -1, error);
        return TRUE;
    }

    int answer(unsigned request, UMockdevIoctlData* argument) {
        if (gone_ && request != static_cast<unsigned>(USBDEVFS_REAPURBNDELAY)) return ENODEV;
        switch (request) {
            case static_cast<unsigned>(USBDEVFS_GET_CAPABILITIES): {
                UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, 4, nullptr);
                *reinterpret_cast<std::uint32_t*>(data->data) =
                    USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION;
                return 0;
            }
            case static_cast<unsigned>(USBDEVFS_CLAIMINTERFACE):
            case static_cast<unsigned>(USBDEVFS_RELEASEINTERFACE):
            case static_cast<unsigned>(USBDEVFS_DISCONNECT_CLAIM):
            case static_cast<unsigned>(USBDEVFS_IOCTL):
            case static_cast<unsigned>(USBDEVFS_CLEAR_HALT):
            case static_cast<unsigned>(USBDEVFS_RESET):
                return 0;
            case static_cast<unsigned>(USBDEVFS_GETDRIVER):
                return ENODATA;
            case static_cast<unsigned>(USBDEVFS_DISCARDURB):
                if (pending_.empty()) return EINVAL;
                done_.push_back({pending_.front().data, -ENOENT});
                pending_.pop_front();
                return 0;
            case static_cast<unsigned>(USBDEVFS_SUBMITURB): {
                UMockdevIoctlData* data = umockdev_ioctl_data_resolve(argument, 0, sizeof(usbdevfs_urb), nullptr);
                auto* urb = reinterpret_cast<usbdevfs_urb*>(data->data);
                if (urb->type != USBDEVFS_URB_TYPE_INTERRUPT && urb->type != USBDEVFS_URB_TYPE_BULK) return EINVAL;
                UMockdevIoctlData* buffer = umockdev_ioctl_data_resolve(
                    data, offsetof(usbdevfs_urb, buffer), static_cast<gsize>(urb->buffer_length), nullptr);
                g_object_ref(data);
                g_object_ref(buffer);
                pending_.push_back({data, 0});
                return 0;
            }
            case static_cast<unsigned>(USBDEVFS_REAPURBNDELAY): {
                if (done_.empty()) return gone_ ? ENODEV : EAGAIN;
                const Urb urb = done_.front();
                done_.pop_front();
                reinterpret_cast<usbdevfs_urb*>(urb.data->data)->status = urb.status;
                UMockdevIoctlData* slot = umockdev_ioctl_data_resolve(argument, 0, sizeof(void*), nullptr);
                umockdev_ioctl_data_set_ptr(slot, 0, urb.data);
                return 0;
            }
            default:
                return ENOTTY;
        }
    }

    UMockdevTestbed* testbed_;
    UMockdevIoctlBase* base_ = nullptr;
    std::mutex mutex_;
    std::deque<Urb> pending_, done_;
    bool gone_ = false, plugged_ = false;
};

}  // namespace teres::test
