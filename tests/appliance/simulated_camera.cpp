// A RealSense D435 in user space for the kernel's own uvcvideo: USB/IP over a socket pair, one end of which vhci_hcd is
// given. Depth (Z16) and colour (YUYV), 320x240 at 15 Hz, bulk, one payload per frame; extension unit 3 with its
// tables. Usage (root, vhci_hcd loaded): simulated_camera [--usb2]. SIGUSR1: no frames until a hardware reset. Killing
// it is unplugging it. Sources: kernel Documentation/usb/usbip_protocol.rst; USB 3.0, chapter 9; USB Video Class 1.1.
#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "core/clock.h"
#include "tests/drivers/camera/realsense_tables.h"

namespace teres::test {
namespace {

using realsense::Bytes;
constexpr int kWidth = 320, kHeight = 240;
constexpr std::uint32_t kFrameBytes = 2 * kWidth * kHeight, kPayloadHeader = 12, kInterval100ns = 666'666;
constexpr std::uint32_t kDeviceId = 1 << 16 | 2;

volatile std::sig_atomic_t frames_stopped = 0;

// Little-endian text of descriptors.
struct Writer {
    Bytes bytes;
    Writer& u8(std::initializer_list<int> values) {
        for (const int value : values) bytes.push_back(static_cast<std::uint8_t>(value));
        return *this;
    }
    Writer& u16(std::uint32_t value) {
        return u8({static_cast<int>(value & 0xff), static_cast<int>(value >> 8 & 0xff)});
    }
    Writer& u32(std::uint32_t value) { return u16(value & 0xffff).u16(value >> 16); }
    Writer& add(const Bytes& more) {
        bytes.insert(bytes.end(), more.begin(), more.end());
        return *this;
    }
};

// A video function: control interface, streaming interface with one format of one size, one bulk endpoint.
struct Stream {
    int control_interface, endpoint;
    std::array<char, 4> format;
    bool has_extension_unit;
    // State.
    struct Urb {
        std::uint32_t sequence, bytes;
    };
    std::deque<Urb> urbs{};
    Bytes payload{};
    std::size_t sent = 0;
    std::uint32_t frame = 0;
    std::int64_t due_us = 0;

    int streaming_interface() const { return control_interface + 1; }
};

class Camera {
  public:
    explicit Camera(bool usb2) : usb2_(usb2) {
        tables_[realsense::kIdentity] = identity_block();
        tables_[realsense::kCalibration + 256 * realsense::kDepthTable] =
            TableWriter(25, 512).floats(160, {-50.0f}).floats(256 + 6 * 16, {193.0f, 193.5f, 160.5f, 119.5f}).done();
        tables_[realsense::kCalibration + 256 * realsense::kColorTable] = color_table();
        tables_[realsense::kAdvancedValue + 256 * realsense::kDepthControl] = depth_control(500);
    }

    bool attach() {
        int pair[2];
        if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0) return false;
        const int room = 1 << 22;
        setsockopt(pair[1], SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
        std::FILE* file = std::fopen("/sys/devices/platform/vhci_hcd.0/attach", "w");
        if (file == nullptr) return false;
        // port, socket, device id, speed; ports from 8 on are of the USB 3 hub
        std::fprintf(file, "%d %d %u %d", usb2_ ? 0 : 8, pair[0], kDeviceId, usb2_ ? 3 : 5);
        const bool taken = std::fclose(file) == 0;
        close(pair[0]);
        socket_ = pair[1];
        if (!taken) close(socket_);
        return taken;
    }

    /// Until the kernel lets go (false) or a hardware reset is asked for (true).
    bool serve() {
        for (;;) {
            pollfd ready{socket_, POLLIN, 0};
            const int count = poll(&ready, 1, wait_ms());
            if (count < 0 && errno != EINTR) break;
            if (count > 0 && !request()) break;
            if (reset_) break;
            if (frames_stopped == 0)
                for (Stream& stream : streams_) feed(stream);
        }
        close(socket_);
        for (Stream& stream : streams_) stream.urbs.clear();
        return std::exchange(reset_, false);
    }

  private:
    using Header = std::array<std::uint32_t, 12>;  // of USB/IP, 48 bytes, big-endian
    enum : std::uint32_t { kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4 };

    bool receive(void* to, std::size_t size) {
        return size == 0 || recv(socket_, to, size, MSG_WAITALL) == static_cast<ssize_t>(size);
    }
    bool send_all(const void* from, std::size_t size) {
        const auto* bytes = static_cast<const char*>(from);
        while (size > 0) {
            const ssize_t done = send(socket_, bytes, size, MSG_NOSIGNAL);
            if (done < 0 && errno == EINTR) continue;
            if (done <= 0) return false;
            bytes += done;
            size -= static_cast<std::size_t>(done);
        }
        return true;
    }
    bool answer(std::uint32_t command, std::uint32_t sequence, int status, std::uint32_t actual,
                std::span<const std::uint8_t> data = {}) {
        Header header{};
        header[0] = htonl(command);
        header[1] = htonl(sequence);
        header[5] = htonl(static_cast<std::uint32_t>(status));
        header[6] = htonl(actual);
        header[8] = command == kSubmitted ? 0xffffffff : 0;  // no isochronous packets
        return send_all(header.data(), sizeof header) && send_all(data.data(), data.size());
    }

    bool request() {
        Header header;
        if (!receive(header.data(), sizeof header)) return false;
        const std::uint32_t command = ntohl(header[0]), sequence = ntohl(header[1]), bytes = ntohl(header[6]);
        if (command == kUnlink) {
            const std::uint32_t wanted = ntohl(header[5]);
            bool found = false;
            for (Stream& stream : streams_)
                found |= std::erase_if(stream.urbs, [&](const Stream::Urb& urb) { return urb.sequence == wanted; }) > 0;
            return answer(kUnlinked, sequence, found ? -ECONNRESET : 0, 0);
        }
        if (command != kSubmit) return false;
        const bool in = ntohl(header[3]) == 1;
        const int endpoint = static_cast<int>(ntohl(header[4]));
        Bytes out(in ? 0 : bytes);
        if (!receive(out.data(), out.size())) return false;
        if (endpoint == 0) {
            std::array<std::uint8_t, 8> setup;
            std::memcpy(setup.data(), &header[10], setup.size());
            std::optional<Bytes> data = control(setup, out);
            if (!data) return answer(kSubmitted, sequence, -EPIPE, 0);
            if (in && data->size() > bytes) data->resize(bytes);
            return answer(kSubmitted, sequence, 0, in ? static_cast<std::uint32_t>(data->size()) : bytes,
                          in ? std::span<const std::uint8_t>(*data) : std::span<const std::uint8_t>());
        }
        for (Stream& stream : streams_)
            if (in && stream.endpoint == endpoint) {
                stream.urbs.push_back({sequence, bytes});
                return true;
            }
        return answer(kSubmitted, sequence, -EPIPE, 0);
    }

    int wait_ms() const {
        std::int64_t wait_us = 100'000;
        for (const Stream& stream : streams_)
            if (!stream.urbs.empty())
                wait_us = std::min(wait_us, std::max<std::int64_t>(0, stream.due_us - monotonic_us()));
        return frames_stopped != 0 ? 100 : static_cast<int>((wait_us + 999) / 1000);
    }

    // What is due of the frame goes into the buffers that the host has queued.
    void feed(Stream& stream) {
        const std::int64_t now_us = monotonic_us();
        if (stream.urbs.empty() || now_us < stream.due_us) return;
        if (stream.sent == 0) compose(stream);
        while (!stream.urbs.empty() && stream.sent < stream.payload.size()) {
            const Stream::Urb urb = stream.urbs.front();
            stream.urbs.pop_front();
            const std::size_t size = std::min<std::size_t>(urb.bytes, stream.payload.size() - stream.sent);
            answer(kSubmitted, urb.sequence, 0, static_cast<std::uint32_t>(size),
                   std::span(stream.payload).subspan(stream.sent, size));
            stream.sent += size;
        }
        if (stream.sent < stream.payload.size()) return;
        stream.sent = 0;
        ++stream.frame;
        stream.due_us = std::max(stream.due_us, now_us - kInterval100ns / 10) + kInterval100ns / 10;
    }
    static void compose(Stream& stream) {
        constexpr int kEndOfFrame = 0x02, kPts = 0x04, kScr = 0x08, kEndOfHeader = 0x80;
        const std::uint32_t stamp = stream.frame * (kInterval100ns * 3);  // of a clock of 30 MHz
        stream.payload =
            Writer()
                .u8({kPayloadHeader, static_cast<int>(stream.frame & 1) | kEndOfFrame | kPts | kScr | kEndOfHeader})
                .u32(stamp)
                .u32(stamp)
                .u16(0)
                .bytes;
        for (std::uint32_t i = 0; i < kFrameBytes / 2; ++i) {
            const std::uint32_t value = 500 + stream.frame + i % kWidth;
            stream.payload.push_back(static_cast<std::uint8_t>(value));
            stream.payload.push_back(static_cast<std::uint8_t>(value >> 8));
        }
    }

    // Control transfers; nothing: stall.
    std::optional<Bytes> control(std::span<const std::uint8_t, 8> setup, const Bytes& out) {
        const int type = setup[0], what = setup[1], value = setup[2] | setup[3] << 8, index = setup[4] | setup[5] << 8;
        constexpr int kStandardIn = 0x80, kClearFeature = 1, kGetDescriptor = 6;
        if (type == kStandardIn && what == kGetDescriptor) return descriptor(value >> 8, value & 0xff);
        if (type == 0x02 && what == kClearFeature)  // a stream ends or begins: with a whole frame
            for (Stream& stream : streams_) stream.sent = stream.endpoint == (index & 0xf) ? 0 : stream.sent;
        if ((type & 0x60) == 0) return Bytes(type == kStandardIn ? 2 : type == 0x81 ? 1 : 0);  // status, interface
        if ((type & 0x7f) == 0x21) return video_control(what, value >> 8, index >> 8, index & 0xff, out);
        return std::nullopt;
    }

    enum {
        kSetCur = 0x01,
        kGetCur = 0x81,
        kGetMin = 0x82,
        kGetMax = 0x83,
        kGetRes = 0x84,
        kGetLen = 0x85,
        kGetInfo = 0x86
    };

    std::optional<Bytes> video_control(int what, int selector, int entity, int interface, const Bytes& out) {
        for (const Stream& stream : streams_) {
            if (interface == stream.streaming_interface()) {  // probe and commit: there is only one answer
                if (what == kSetCur) return Bytes();
                if (what == kGetLen) return Writer().u16(34).bytes;
                if (what == kGetInfo) return Bytes{3};
                return Writer()
                    .u16(1)
                    .u8({1, 1})
                    .u32(kInterval100ns)
                    .u16(0)
                    .u16(0)
                    .u16(0)
                    .u16(0)
                    .u16(0)
                    .u32(kFrameBytes)
                    .u32(kFrameBytes + kPayloadHeader)
                    .u32(30'000'000)
                    .u8({0, 0, 0, 0})
                    .bytes;
            }
            if (interface == stream.control_interface && entity == 3 && stream.has_extension_unit)
                return extension_unit(what, selector, out);
        }
        if (entity == 0 && selector == 2) return Bytes{0};  // no error
        return std::nullopt;
    }

    std::optional<Bytes> extension_unit(int what, int selector, const Bytes& out) {
        const std::size_t size = selector == 1 ? realsense::kPacketBytes : selector == 9 ? 4 : 1;
        if (what == kGetLen) return Writer().u16(static_cast<std::uint32_t>(size)).bytes;
        if (what == kGetInfo) return Bytes{3};
        if (what == kGetMax) return Bytes(size, 0xff);
        if (what == kSetCur) {
            if (selector != 1) return Bytes();
            if (out.size() < 12) return std::nullopt;
            std::memcpy(&opcode_, out.data() + 4, 4);
            std::memcpy(&parameter_, out.data() + 8, 4);
            reset_ = opcode_ == realsense::kHardwareReset;
            return Bytes();
        }
        if (selector == 9) return Bytes{1, 1, 41, 38};
        Bytes packet(size);
        if (selector != 1 || what != kGetCur) return packet;
        const Bytes& table = tables_[opcode_ + 256 * parameter_];
        const std::int32_t echo = table.empty() ? -6 : static_cast<std::int32_t>(opcode_);
        const auto length = static_cast<std::uint32_t>(table.size());
        std::memcpy(packet.data(), &echo, 4);
        std::copy(table.begin(), table.end(), packet.begin() + 4);
        std::memcpy(packet.data() + 1020, &length, 4);
        return packet;
    }

    std::optional<Bytes> descriptor(int type, int index) const {
        constexpr int kDevice = 1, kConfiguration = 2, kString = 3, kQualifier = 6, kBos = 15;
        switch (type) {
            case kDevice:
                return Writer()
                    .u8({18, kDevice})
                    .u16(usb2_ ? 0x0200 : 0x0300)
                    .u8({0xef, 2, 1, usb2_ ? 64 : 9})
                    .u16(0x8086)
                    .u16(0x0b07)
                    .u16(0x50da)
                    .u8({1, 2, 3, 1})
                    .bytes;
            case kConfiguration:
                return configuration();
            case kString:
                return string(index);
            case kQualifier:
                return Bytes{10, kQualifier, 0, 2, 0xef, 2, 1, 64, 1, 0};
            case kBos:
                return Writer().u8({5, kBos, 22, 0, 2, 7, 16, 2, 0, 0, 0, 0, 10, 16, 3, 0, 0x0e, 0, 1, 0, 0, 0}).bytes;
        }
        return std::nullopt;
    }
    static Bytes string(int index) {
        if (index == 0) return {4, 3, 9, 4};
        const std::string text = index == 1 ? "Teres tests" : index == 2 ? "Simulated D435" : "123456789abc";
        Writer writer;
        writer.u8({static_cast<int>(2 + 2 * text.size()), 3});
        for (const char letter : text) writer.u16(static_cast<unsigned char>(letter));
        return writer.bytes;
    }
    Bytes configuration() const {
        Bytes functions;
        for (const Stream& stream : streams_) {
            const Bytes more = function(stream);
            functions.insert(functions.end(), more.begin(), more.end());
        }
        return Writer()
            .u8({9, 2})
            .u16(static_cast<std::uint32_t>(9 + functions.size()))
            .u8({4, 1, 0, 0x80, 50})
            .add(functions)
            .bytes;
    }
    Bytes function(const Stream& stream) const {
        constexpr int kClassSpecific = 0x24, kVideo = 0x0e;
        const int control = stream.control_interface, streaming = stream.streaming_interface(),
                  endpoint = 0x80 | stream.endpoint;
        // Camera terminal 1 -> extension unit 3 -> output terminal 4.
        Writer chain;
        chain.u8({18, kClassSpecific, 2, 1}).u16(0x0201).u8({0, 0}).u16(0).u16(0).u16(0).u8({3, 0, 0, 0});
        if (stream.has_extension_unit)
            chain.u8({27,   kClassSpecific, 6,    3,    0xcb, 0x6c, 0x60, 0xc9, 0x4c, 0x59, 0x25, 0x4d, 0xaf, 0x47,
                      0xcc, 0xc4,           0x96, 0x43, 0x59, 0x95, 16,   1,    1,    2,    0xff, 0x01, 0});
        chain.u8({9, kClassSpecific, 3, 4}).u16(0x0101).u8({0, stream.has_extension_unit ? 3 : 1, 0});
        // One uncompressed format of 16 bit, one size.
        Writer format;
        format.u8({27, kClassSpecific, 4, 1, 1})
            .u8({stream.format[0], stream.format[1], stream.format[2], stream.format[3]})
            .u8({0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71})
            .u8({16, 1, 0, 0, 0, 0});
        format.u8({30, kClassSpecific, 5, 1, 0})
            .u16(kWidth)
            .u16(kHeight)
            .u32(kFrameBytes * 8 * 15)
            .u32(kFrameBytes * 8 * 15)
            .u32(kFrameBytes)
            .u32(kInterval100ns)
            .u8({1})
            .u32(kInterval100ns);
        Writer writer;
        writer.u8({8, 11, control, 2, kVideo, 3, 0, 0});
        writer.u8({9, 4, control, 0, 0, kVideo, 1, 0, 0});
        writer.u8({13, kClassSpecific, 1})
            .u16(0x0110)
            .u16(static_cast<std::uint32_t>(13 + chain.bytes.size()))
            .u32(30'000'000)
            .u8({1, streaming})
            .add(chain.bytes);
        writer.u8({9, 4, streaming, 0, 1, kVideo, 2, 0, 0});
        writer.u8({14, kClassSpecific, 1, 1})
            .u16(static_cast<std::uint32_t>(14 + format.bytes.size()))
            .u8({endpoint, 0, 4, 0, 0, 0, 1, 0})
            .add(format.bytes);
        writer.u8({7, 5, endpoint, 2}).u16(usb2_ ? 512 : 1024).u8({0});
        if (!usb2_) writer.u8({6, 0x30, 0, 0, 0, 0});
        return writer.bytes;
    }

    bool usb2_;
    int socket_ = -1;
    bool reset_ = false;
    std::uint32_t opcode_ = 0, parameter_ = 0;
    std::map<std::uint32_t, Bytes> tables_;  // by opcode + 256 * parameter
    std::array<Stream, 2> streams_{Stream{0, 1, {'Z', '1', '6', ' '}, true}, Stream{2, 2, {'Y', 'U', 'Y', '2'}, false}};
};

}  // namespace
}  // namespace teres::test

int main(int argc, char** argv) {
    std::signal(SIGUSR1, [](int) { teres::test::frames_stopped = 1; });
    teres::test::Camera camera(argc > 1 && std::strcmp(argv[1], "--usb2") == 0);
    do {
        bool attached = false;
        for (int attempt = 0; attempt < 50 && !attached; ++attempt) {  // the port needs a moment after a reset
            if (attempt > 0) usleep(100'000);
            attached = camera.attach();
        }
        if (!attached) {
            std::fprintf(stderr, "simulated_camera: vhci_hcd does not take it (root? modprobe vhci_hcd?)\n");
            return 3;
        }
        std::printf("attached\n");
        std::fflush(stdout);
        teres::test::frames_stopped = 0;
    } while (camera.serve());
    return 0;
}
