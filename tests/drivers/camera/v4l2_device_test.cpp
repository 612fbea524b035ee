// The capture node against a made-up kernel: every way to get buffers, every errno, every kind of bad frame.
#include "drivers/camera/v4l2_device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/camera/fake_camera.h"

namespace teres {
namespace {

using test::FakeCamera;
using testing::HasSubstr;
using Outcome = V4l2Device::Outcome;

CaptureRequest depth_request() {
    return {V4L2_PIX_FMT_Z16, 640, 480, 30.0};
}

V4l2Device started(FakeCamera& camera, const CaptureRequest& request = depth_request()) {
    auto device = V4l2Device::open(camera, camera.node(), request);
    EXPECT_TRUE(device) << device.error().text;
    return std::move(*device);
}

Outcome next(V4l2Device& device, Frame& frame) {
    return device.next(frame, 100);
}

struct Way {
    bool mmap, userptr, read;
    BufferMethod expected;
};

class BufferWays : public testing::TestWithParam<Way> {};

TEST_P(BufferWays, FallsBackToWhatTheNodeCanDo) {
    FakeCamera camera;
    camera.offers_mmap = GetParam().mmap;
    camera.offers_userptr = GetParam().userptr;
    camera.offers_read = GetParam().read;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    EXPECT_EQ(device.method(), GetParam().expected);
    Frame frame;
    for (std::uint16_t i = 0; i < 10; ++i) {
        ASSERT_EQ(next(device, frame), Outcome::kFrame) << device.fault();
        ASSERT_EQ(frame.data.size(), FakeCamera::kFrameBytes);
        std::uint16_t pixel = 0;
        std::memcpy(&pixel, frame.data.data() + 2 * 7, 2);
        EXPECT_EQ(pixel, 500 + i + 7);
        EXPECT_EQ(frame.sequence, i);
    }
    device.stop();
    EXPECT_EQ(camera.mappings, 0);
}
INSTANTIATE_TEST_SUITE_P(Ways, BufferWays,
                         testing::Values(Way{true, true, true, BufferMethod::kMmap},
                                         Way{false, true, true, BufferMethod::kUserptr},
                                         Way{false, false, true, BufferMethod::kRead}));

TEST(V4l2Device, FallsBackWhenTheKernelRefusesTheMapping) {
    FakeCamera camera;
    camera.mmap_error = ENOMEM;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    EXPECT_EQ(device.method(), BufferMethod::kUserptr);
}

TEST(V4l2Device, SaysSoWhenThereIsNoWay) {
    FakeCamera camera;
    camera.offers_mmap = camera.offers_userptr = camera.offers_read = false;
    V4l2Device device = started(camera);
    EXPECT_THAT(device.start().error().text, HasSubstr("neither MMAP nor USERPTR"));
}

// A real driver answers an unsupported Z16 with YUYV of the very same size.
TEST(V4l2Device, RefusesAnotherFormatOfTheSameSize) {
    FakeCamera camera;
    camera.fourcc = V4L2_PIX_FMT_YUYV;
    const auto device = V4l2Device::open(camera, camera.node(), depth_request());
    ASSERT_FALSE(device);
    EXPECT_EQ(device.error().kind, ErrorKind::kInvalidInput);
    EXPECT_THAT(device.error().text, HasSubstr("Z16  640x480 not offered; the driver gives YUYV 640x480"));
    EXPECT_EQ(camera.open_nodes, 0) << "left open";
}

TEST(V4l2Device, RefusesAnotherSize) {
    FakeCamera camera;
    CaptureRequest request = depth_request();
    request.width_px = 848;
    const auto device = V4l2Device::open(camera, camera.node(), request);
    ASSERT_FALSE(device);
    EXPECT_THAT(device.error().text, HasSubstr("848x480 not offered; the driver gives Z16  640x480"));
}

struct Refusal {
    unsigned long request;
    int error;
    bool at_open;
    ErrorKind kind;
    const char* text;
};

class RefusedCall : public testing::TestWithParam<Refusal> {};

TEST_P(RefusedCall, IsAnErrorWithCallAndReasonAndLeavesNothingBehind) {
    const Refusal& refusal = GetParam();
    FakeCamera camera;
    camera.always[refusal.request] = refusal.error;
    {
        auto device = V4l2Device::open(camera, camera.node(), depth_request());
        ASSERT_EQ(!device, refusal.at_open);
        const Error error = device ? device->start().error() : device.error();
        EXPECT_EQ(error.kind, refusal.kind) << error.text;
        EXPECT_THAT(error.text, HasSubstr(refusal.text));
    }
    EXPECT_EQ(camera.mappings, 0);
    EXPECT_EQ(camera.open_nodes, 0);
}
INSTANTIATE_TEST_SUITE_P(
    Errnos, RefusedCall,
    testing::Values(Refusal{VIDIOC_QUERYCAP, ENOTTY, true, ErrorKind::kHostFault, "QUERYCAP: Inappropriate ioctl"},
                    Refusal{VIDIOC_S_FMT, EBUSY, true, ErrorKind::kNotUsable, "another program uses the camera"},
                    Refusal{VIDIOC_S_FMT, EIO, true, ErrorKind::kHostFault, "S_FMT: Input/output error"},
                    Refusal{VIDIOC_S_PARM, EIO, true, ErrorKind::kHostFault, "S_PARM"},
                    Refusal{VIDIOC_REQBUFS, EBUSY, false, ErrorKind::kNotUsable, "REQBUFS: Device or resource busy"},
                    Refusal{VIDIOC_REQBUFS, ENOMEM, false, ErrorKind::kHostFault, "REQBUFS: Cannot allocate"},
                    Refusal{VIDIOC_QUERYBUF, EIO, false, ErrorKind::kHostFault, "QUERYBUF"},
                    Refusal{VIDIOC_QBUF, EIO, false, ErrorKind::kHostFault, "QBUF"},
                    Refusal{VIDIOC_STREAMON, ENOSPC, false, ErrorKind::kHostFault, "STREAMON: No space left"},
                    Refusal{VIDIOC_STREAMON, EPROTO, false, ErrorKind::kHostFault, "STREAMON: Protocol error"}));

TEST(V4l2Device, NodeThatCannotBeOpenedNamesTheRemedy) {
    FakeCamera camera;
    camera.open_error = EACCES;
    const auto device = V4l2Device::open(camera, camera.node(), depth_request());
    EXPECT_EQ(device.error().kind, ErrorKind::kNotUsable);
    EXPECT_THAT(device.error().text, HasSubstr("group video"));
}

TEST(V4l2Device, NodeWithoutRateControlIsTaken) {
    FakeCamera camera;
    camera.always[VIDIOC_S_PARM] = ENOTTY;
    EXPECT_EQ(started(camera).format().rate_hz, 0.0);
}

struct Broken {
    int error;
    Outcome outcome;
};

class BrokenDequeue : public testing::TestWithParam<Broken> {};

TEST_P(BrokenDequeue, IsToldApart) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    camera.errors[VIDIOC_DQBUF] = {GetParam().error};
    Frame frame;
    EXPECT_EQ(next(device, frame), GetParam().outcome) << device.fault();
    EXPECT_EQ(next(device, frame), Outcome::kFrame) << "a single error is not the end";
}
INSTANTIATE_TEST_SUITE_P(Errnos, BrokenDequeue,
                         testing::Values(Broken{EAGAIN, Outcome::kNone}, Broken{EINTR, Outcome::kFrame},
                                         Broken{EIO, Outcome::kFailed}, Broken{EINVAL, Outcome::kFailed},
                                         Broken{EPIPE, Outcome::kFailed}, Broken{ENODEV, Outcome::kGone},
                                         Broken{ENXIO, Outcome::kGone}, Broken{ESHUTDOWN, Outcome::kGone}));

TEST(V4l2Device, BrokenPollAndReadAreToldApart) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    Frame frame;
    camera.poll_error = EINTR;
    EXPECT_EQ(next(device, frame), Outcome::kNone);
    camera.poll_error = EBADF;
    EXPECT_EQ(next(device, frame), Outcome::kFailed);
    camera.poll_error = 0;
    camera.errors[VIDIOC_QBUF] = {EIO};
    EXPECT_EQ(next(device, frame), Outcome::kFailed);

    FakeCamera by_read;
    by_read.offers_mmap = by_read.offers_userptr = false;
    V4l2Device reader = started(by_read);
    ASSERT_TRUE(reader.start());
    for (const auto& [error, outcome] :
         {std::pair{EAGAIN, Outcome::kNone}, {EIO, Outcome::kFailed}, {ENODEV, Outcome::kGone}}) {
        by_read.read_error = error;
        EXPECT_EQ(next(reader, frame), outcome) << error;
    }
    by_read.read_error = 0;
    EXPECT_EQ(next(reader, frame), Outcome::kFrame);
    EXPECT_TRUE(reader.stamps_on_arrival());
}

TEST(V4l2Device, StampIsTheBuffersOnTheMonotonicClock) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    camera.stamps = {camera.clock_us + 12'345};
    Frame frame;
    ASSERT_EQ(next(device, frame), Outcome::kFrame);
    EXPECT_EQ(frame.capture_us, 1'000'012'345);
    EXPECT_FALSE(device.stamps_on_arrival());
}

TEST(V4l2Device, GapsAreCountedAlsoOverTheWrap) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    camera.sequences = {0xfffffffe, 0xffffffff, 2, 3, 10};
    Frame frame;
    std::vector<std::int64_t> got;
    for (int i = 0; i < 5; ++i) {
        ASSERT_EQ(next(device, frame), Outcome::kFrame) << device.fault();
        got.push_back(frame.sequence);
    }
    EXPECT_EQ(got, (std::vector<std::int64_t>{0, 1, 4, 5, 12}));
    EXPECT_EQ(device.lost(), 2 + 6);
}

TEST(V4l2Device, OldRepeatedShortFlaggedAndFutureFramesAreNotFrames) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    Frame frame;
    ASSERT_EQ(next(device, frame), Outcome::kFrame);
    const auto damaged = [&](const char* why) {
        EXPECT_EQ(next(device, frame), Outcome::kDamaged) << why;
        EXPECT_THAT(device.fault(), HasSubstr(why));
    };
    camera.sequences = {0};  // the same again
    damaged("repeated");
    camera.sequences = {0xffffffff};  // one before
    damaged("repeated");
    camera.sequences = {1};
    camera.stamps = {5};
    damaged("out-of-order");
    camera.sizes = {FakeCamera::kFrameBytes - 1};
    damaged("short frame: 614399 of 614400");
    camera.sizes = {0};
    damaged("short frame");
    camera.flags = {V4L2_BUF_FLAG_ERROR};
    damaged("flagged");
    camera.stamps = {camera.clock_us + 60'000'000};
    damaged("future");
    EXPECT_EQ(next(device, frame), Outcome::kFrame);
}

TEST(V4l2Device, FrameLargerThanItsFormatIsCut) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    ASSERT_TRUE(device.start());
    camera.sizes = {2 * FakeCamera::kFrameBytes};
    Frame frame;
    ASSERT_EQ(next(device, frame), Outcome::kFrame);
    EXPECT_EQ(frame.data.size(), FakeCamera::kFrameBytes);
}

TEST(V4l2Device, ControlsGoByName) {
    FakeCamera camera;
    V4l2Device device = started(camera);
    EXPECT_TRUE(device.set_control("gain_analogue", 99));
    EXPECT_EQ(camera.gain, 99);
    EXPECT_THAT(device.set_control("gain_analogue", 129).error().text, HasSubstr("= 129 is out of [0, 128]"));
    EXPECT_THAT(device.set_control("gian", 1).error().text, HasSubstr("no control gian; there are: gain_analogue"));
    camera.gain_sticks = true;
    EXPECT_THAT(device.set_control("gain_analogue", 12).error().text, HasSubstr("was not taken over: it is 99"));
    camera.always[VIDIOC_S_CTRL] = EBUSY;
    EXPECT_EQ(device.set_control("gain_analogue", 12).error().kind, ErrorKind::kNotUsable);
}

TEST(Fourcc, TextAndNumberAgree) {
    EXPECT_EQ(fourcc_of("Z16"), V4L2_PIX_FMT_Z16);
    EXPECT_EQ(fourcc_text(V4L2_PIX_FMT_YUYV), "YUYV");
    EXPECT_EQ(fourcc_of(""), 0u);
    EXPECT_EQ(fourcc_of("YUYV2"), 0u);
}

}  // namespace
}  // namespace teres
