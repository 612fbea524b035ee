// One V4L2 capture node: format negotiated and verified, buffers in the first way that the node can do (MMAP, USERPTR,
// read), frames copied out with the stamp of the buffer. Nothing here waits longer than asked for, apart from the
// kernel itself: call it from a thread of its own.
//
// Errors: kInvalidInput if the node cannot do what is asked (text: what it offers), kNotUsable if another program has
// it or the user may not, kHostFault if a call failed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"
#include "drivers/device/system_calls.h"

namespace teres {

std::uint32_t fourcc_of(const std::string& text);  ///< "Z16" and "Z16 " are the same; 0 if not 1..4 letters
std::string fourcc_text(std::uint32_t fourcc);     ///< four letters

enum class BufferMethod { kMmap, kUserptr, kRead };

struct CaptureRequest {
    std::uint32_t fourcc = 0;
    int width_px = 640, height_px = 480;
    double rate_hz = 30.0;  ///< 0: whatever the device does
    bool try_mmap = true, try_userptr = true, try_read = true;
};

struct CaptureFormat {
    std::uint32_t fourcc = 0;
    int width_px = 0, height_px = 0;
    int row_stride_bytes = 0;     ///< 0: compressed
    std::size_t frame_bytes = 0;  ///< of an uncompressed frame, exactly; of a compressed one, at most
    double rate_hz = 0.0;         ///< 0: not told
};

struct Frame {
    std::int64_t capture_us = 0;  ///< monotonic clock
    std::int64_t sequence = 0;    ///< counts lost frames as gaps; goes on over restarts of the stream
    std::vector<std::uint8_t> data;
};

class V4l2Device {
  public:
    /// Opens the node and makes sure that it captures what was asked for: drivers answer an unknown format with
    /// another one of the same size.
    static Result<V4l2Device> open(SystemCalls& calls, const std::filesystem::path& node,
                                   const CaptureRequest& request);
    V4l2Device(V4l2Device&& other) noexcept;
    V4l2Device& operator=(V4l2Device&&) = delete;
    ~V4l2Device();

    Status start();
    void stop() noexcept;

    enum class Outcome {
        kFrame,    ///< `to` holds a new frame
        kNone,     ///< nothing came within the time
        kDamaged,  ///< a frame flagged as an error, short, repeated or out of order; fault() says which
        kFailed,   ///< a call failed; fault() says which
        kGone      ///< unplugged
    };
    Outcome next(Frame& to, int timeout_ms);

    /// Control by its name as v4l2-ctl prints it (exposure_time_absolute). Errors: unknown (lists the known), out of
    /// range (names the bounds), read-only or inactive, refused, or not taken over.
    Status set_control(const std::string& name, std::int64_t value);

    const CaptureFormat& format() const { return format_; }
    BufferMethod method() const { return method_; }
    const std::string& fault() const { return fault_; }
    std::int64_t lost() const { return lost_; }
    /// The driver stamps buffers on another clock: stamps are taken on arrival instead.
    bool stamps_on_arrival() const { return stamps_on_arrival_; }
    int fd() const { return fd_; }
    /// After re-opening: numbers go on behind `sequence`, a frame not newer than `newest_us` is an old one.
    void continue_after(std::int64_t sequence, std::int64_t newest_us) {
        sequence_ = sequence;
        newest_us_ = newest_us;
    }

  private:
    struct Buffer {
        void* address = nullptr;
        std::size_t length = 0;
    };

    V4l2Device(SystemCalls& calls, int fd, std::filesystem::path node)
        : calls_(&calls), fd_(fd), node_(std::move(node)) {}
    int control(unsigned long request, void* argument);  // ioctl, again after EINTR
    tl::unexpected<Error> failed(const std::string& what) const;
    Status negotiate(const CaptureRequest& request);
    Status set_rate(double rate_hz);
    Result<bool> request_buffers(BufferMethod method);
    bool queue(std::uint32_t index);
    void release_buffers() noexcept;
    Outcome gone_or_failed(const char* what);
    Outcome next_by_read(Frame& to);
    Outcome next_from_queue(Frame& to);
    Outcome accept(Frame& to, std::uint32_t device_sequence, std::int64_t capture_us);

    SystemCalls* calls_;
    int fd_ = -1;
    std::filesystem::path node_;
    CaptureRequest request_;
    CaptureFormat format_;
    bool can_stream_ = false, can_read_ = false;
    BufferMethod method_ = BufferMethod::kMmap;
    std::vector<Buffer> buffers_;
    bool streaming_ = false;
    bool stamps_on_arrival_ = false;
    std::string fault_;
    std::int64_t sequence_ = -1, lost_ = 0;
    std::int64_t device_sequence_ = -1;  // of this stream
    std::int64_t newest_us_ = -1;
};

}  // namespace teres
