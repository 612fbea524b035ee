// From finding the camera to frames, and back after every fault, on the made-up camera's clock.
#include "drivers/camera/camera_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/drivers/camera/fake_camera.h"

namespace teres {
namespace {

using test::FakeCamera;
using testing::HasSubstr;
constexpr const char* kSerial = "123456789abc";

class CameraStreamTest : public testing::Test {
  protected:
    CameraStream make(const std::string& device = kSerial) {
        StreamSettings settings;
        settings.device = device;
        settings.capture = {V4L2_PIX_FMT_Z16, 640, 480, 30.0};
        settings.controls = controls;
        settings.calibration_folder = camera_.scratch();
        return CameraStream(camera_, camera_.roots(), settings);
    }
    /// Runs the capture thread's part for so long; returns the frames that came.
    int run(CameraStream& stream, double seconds) {
        const std::int64_t end = camera_.clock_us + static_cast<std::int64_t>(seconds * 1e6);
        int frames = 0;
        while (camera_.clock_us < end) {
            stream.pass();
            for (; stream.take(frame_); ++frames) {
                EXPECT_GT(frame_.capture_us, newest_us_) << "a frame that is not new";
                EXPECT_GT(frame_.sequence, sequence_);
                newest_us_ = frame_.capture_us;
                sequence_ = frame_.sequence;
            }
            const DeviceState state = stream.report().state;
            if (states.empty() || states.back() != state) states.push_back(state);
        }
        return frames;
    }
    std::vector<std::pair<std::string, std::int64_t>> controls;
    std::vector<DeviceState> states;
    FakeCamera camera_;
    Frame frame_;
    std::int64_t newest_us_ = 0, sequence_ = -1;
};

using S = DeviceState;

TEST_F(CameraStreamTest, StreamsAllFramesOfTheCameraChosenBySerial) {
    CameraStream stream = make();
    EXPECT_NEAR(run(stream, 2.0), 60, 2);
    const DeviceReport report = stream.report();
    EXPECT_EQ(report.state, S::kStreaming);
    EXPECT_EQ(report.serial, kSerial);
    EXPECT_EQ(report.detail, "");
    EXPECT_EQ(report.lost, 0);
    EXPECT_EQ(report.usb_mbps, 5000);
}

TEST_F(CameraStreamTest, IsChosenByVendorAndProductOrByThePrintedSerial) {
    CameraStream by_id = make("8086:0b07");
    EXPECT_GT(run(by_id, 0.5), 10);
    test::make_realsense(camera_);
    newest_us_ = 0, sequence_ = -1;
    CameraStream by_print = make("842512070299");
    EXPECT_GT(run(by_print, 0.5), 10);
}

TEST_F(CameraStreamTest, CardThatIsNotOnUsbIsChosenByItsName) {
    camera_.unplug();
    camera_.gone = false;
    const auto card = camera_.scratch() / "sys/devices/pci0/video4linux/video1",
               nodes = camera_.scratch() / "sys/class/video4linux";
    std::filesystem::create_directories(card);
    std::ofstream(card / "name") << "Grabber 4K, input 2\n";
    std::filesystem::create_directories(nodes);
    std::filesystem::create_directory_symlink(card, nodes / "video1");
    CameraStream stream = make("Grabber 4K, input 2");
    EXPECT_GT(run(stream, 1.0), 20);
}

TEST_F(CameraStreamTest, AbsentCameraIsNamedWithWhatIsThere) {
    CameraStream stream = make("999");
    EXPECT_EQ(run(stream, 1.0), 0);
    EXPECT_EQ(stream.report().state, S::kAbsent);
    EXPECT_THAT(stream.report().detail,
                HasSubstr("camera 999 is not connected; there are: video0 8086:0b07 serial 12"));
    camera_.unplug();
    run(stream, 0.5);
    EXPECT_THAT(stream.report().detail, HasSubstr("there is no video device"));
}

TEST_F(CameraStreamTest, CameraWithoutTheFormatIsThereButRefused) {
    camera_.fourcc = V4L2_PIX_FMT_YUYV;
    CameraStream stream = make();
    run(stream, 5.0);
    EXPECT_EQ(stream.report().state, S::kRecovering);
    EXPECT_THAT(stream.report().detail, HasSubstr("offers no Z16"));
    EXPECT_EQ(camera_.resets, 0);
    camera_.fourcc = V4L2_PIX_FMT_Z16;
    EXPECT_GT(run(stream, 2.0), 20);
}

// Unplugged in mid-stream, back on another node: found by its serial number within half a second.
TEST_F(CameraStreamTest, ComesBackUnderAnotherNodeAfterUnplugging) {
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.unplug();
    EXPECT_EQ(run(stream, 1.0), 0);
    EXPECT_EQ(stream.report().state, S::kAbsent);
    camera_.plug("video5", kSerial);
    const std::int64_t plugged_us = camera_.clock_us;
    while (!stream.take(frame_)) stream.pass();
    EXPECT_LT(camera_.clock_us - plugged_us, 500'000);
    EXPECT_GT(frame_.capture_us, plugged_us - 34'000);
    EXPECT_GT(frame_.sequence, sequence_);
    run(stream, 0.2);
    EXPECT_THAT(stream.report().node, HasSubstr("video5"));
    EXPECT_EQ(stream.report().recoveries, 1);
    EXPECT_EQ(states, (std::vector<S>{S::kRecovering, S::kStreaming, S::kAbsent, S::kStreaming}));
}

TEST_F(CameraStreamTest, AnotherCameraInItsPlaceIsNotTaken) {
    CameraStream stream = make();
    run(stream, 0.5);
    camera_.unplug();
    run(stream, 0.5);
    camera_.plug("video0", "other");
    EXPECT_EQ(run(stream, 2.0), 0);
    EXPECT_EQ(stream.report().state, S::kAbsent);
}

TEST_F(CameraStreamTest, SingleIoErrorCostsOneRestart) {
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.errors[VIDIOC_DQBUF] = {EIO};
    EXPECT_NEAR(run(stream, 1.0), 29, 2);
    EXPECT_EQ(camera_.restarts, 2);
    EXPECT_EQ(camera_.resets, 0);
    EXPECT_EQ(stream.report().recoveries, 1);
    EXPECT_EQ(stream.report().detail, "");
}

TEST_F(CameraStreamTest, StuckCameraIsRestartedReopenedResetThenAdvised) {
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.silent = true;
    run(stream, 1.3);
    EXPECT_EQ(camera_.restarts, 2);
    run(stream, 1.0);
    EXPECT_EQ(camera_.restarts, 3);  // re-opened
    EXPECT_EQ(camera_.resets, 0);
    run(stream, 1.0);
    EXPECT_EQ(camera_.resets, 1);
    EXPECT_THAT(camera_.usb_path, testing::EndsWith("bus/usb/002/007"));
    run(stream, 4.0);
    EXPECT_THAT(stream.report().detail, HasSubstr("unplug the camera"));
    camera_.silent = false;
    EXPECT_GT(run(stream, 3.5), 5) << "tried again for good";
    EXPECT_EQ(stream.report().detail, "");
}

TEST_F(CameraStreamTest, ResetThatHelpsIsTheEndOfIt) {
    test::make_realsense(camera_);
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.silent = camera_.resets_help = true;
    run(stream, 3.6);
    EXPECT_EQ(camera_.resets, 1);
    EXPECT_EQ(camera_.usb_path, "") << "by the camera's own command";
    EXPECT_GT(run(stream, 1.0), 20);
}

TEST_F(CameraStreamTest, BusyCameraIsAskedAgainButNeverReset) {
    camera_.always[VIDIOC_S_FMT] = EBUSY;
    CameraStream stream = make();
    run(stream, 20.0);
    EXPECT_EQ(camera_.resets, 0);
    EXPECT_EQ(stream.report().state, S::kRecovering);
    EXPECT_THAT(stream.report().detail, HasSubstr("another program uses the camera"));
    camera_.always.clear();
    EXPECT_GT(run(stream, 2.0), 20);
    EXPECT_EQ(camera_.open_nodes, 1) << "descriptors left open";
}

TEST_F(CameraStreamTest, EveryFaultyCallIsSurvivedAndNothingLeaks) {
    const unsigned long calls[] = {VIDIOC_QUERYCAP, VIDIOC_ENUM_FMT, VIDIOC_S_FMT,    VIDIOC_S_PARM, VIDIOC_REQBUFS,
                                   VIDIOC_QUERYBUF, VIDIOC_QBUF,     VIDIOC_STREAMON, VIDIOC_DQBUF};
    for (const unsigned long call : calls) {
        for (const int error : {EIO, EBUSY, EINVAL, ENODEV}) {
            FakeCamera camera;
            CameraStream stream(camera, camera.roots(), {kSerial, {V4L2_PIX_FMT_Z16, 640, 480, 30.0}, {}, {}, {}});
            const auto run_for = [&](double s) {
                const std::int64_t end = camera.clock_us + static_cast<std::int64_t>(1e6 * s);
                int frames = 0;
                while (camera.clock_us < end) {
                    stream.pass();
                    frames += stream.take(frame_) ? 1 : 0;
                }
                return frames;
            };
            run_for(0.5);
            camera.always[call] = error;
            camera.errors[VIDIOC_DQBUF] = {EIO};  // so that everything is opened anew
            run_for(4.5);
            camera.always.clear();
            // asked again after 3 s at the latest (Limits::retry_after_us), then frames come
            EXPECT_GT(run_for(5.0), 20) << call << " " << std::strerror(error) << ": " << stream.report().detail;
            EXPECT_EQ(camera.open_nodes, 1) << call;
            EXPECT_LE(camera.mappings, 4) << call;
        }
    }
}

TEST_F(CameraStreamTest, LateFramesAreNotPassedOn) {
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.late_us = 400'000;
    EXPECT_LE(run(stream, 1.0), 0);
    EXPECT_NE(stream.report().state, S::kStreaming);
    EXPECT_GT(stream.report().damaged, 0);
}

TEST_F(CameraStreamTest, FramesTheLoopDidNotTakeInTimeAreCountedLost) {
    CameraStream stream = make();
    while (stream.report().received < 10) stream.pass();
    EXPECT_EQ(stream.report().lost, 6);
    EXPECT_TRUE(stream.take(frame_));
    EXPECT_EQ(frame_.sequence, 6);
    camera_.clock_us += 1'000'000;
    EXPECT_FALSE(stream.take(frame_)) << "older than a second: not passed on as new";
}

TEST_F(CameraStreamTest, CaptureHeldUpByTheKernelShowsAsStale) {
    CameraStream stream = make();
    run(stream, 1.0);
    camera_.clock_us += 300'000;  // no pass() in the meantime
    EXPECT_EQ(stream.report().state, S::kStale);
    EXPECT_THAT(stream.report().detail, HasSubstr("kernel holds up"));
}

TEST_F(CameraStreamTest, Usb2LinkIsSaid) {
    camera_.unplug();
    camera_.plug("video0", kSerial, "480");
    test::make_realsense(camera_);
    CameraStream stream = make();
    EXPECT_GT(run(stream, 1.0), 20);
    EXPECT_EQ(stream.report().usb_mbps, 480);
    EXPECT_THAT(stream.report().detail, HasSubstr("USB 2 link (480 Mbit/s)"));
}

TEST_F(CameraStreamTest, CalibrationDepthUnitAndTemperatureComeFromTheDevice) {
    test::make_realsense(camera_);
    CameraStream stream = make();
    run(stream, 1.0);
    CameraStream::Info info;
    ASSERT_TRUE(stream.info_since(0, info));
    ASSERT_TRUE(info.calibration) << stream.report().detail;
    EXPECT_FLOAT_EQ(static_cast<float>(info.calibration->fx_px), 386.5f);
    EXPECT_DOUBLE_EQ(info.calibration->depth_unit_m, 1e-4) << "not the usual millimetre";
    EXPECT_NEAR(info.calibration->baseline_m, 0.05003, 1e-6);
    EXPECT_EQ(stream.report().temperature_c, 41.0);
    EXPECT_FALSE(stream.info_since(info.number, info));
}

TEST_F(CameraStreamTest, BrokenCalibrationIsSaidAndNotPublished) {
    test::make_realsense(camera_);
    camera_.tables[realsense::kCalibration + 256 * realsense::kDepthTable][300] ^= 1;
    CameraStream stream = make();
    EXPECT_GT(run(stream, 1.0), 20) << "frames come all the same";
    EXPECT_THAT(stream.report().detail, HasSubstr("calibration table 25: wrong CRC"));
    CameraStream::Info info;
    ASSERT_TRUE(stream.info_since(0, info));
    EXPECT_FALSE(info.calibration);
}

TEST_F(CameraStreamTest, OtherCamerasHaveACalibrationFile) {
    std::ofstream(camera_.scratch() / (std::string(kSerial) + ".toml"))
        << "width_px = 1280\nheight_px = 960\nfx_px = 1000.0\nfy_px = 1010.0\ncx_px = 639.5\ncy_px = 479.5\n"
           "distortion = [0.1, 0.0, 0.0, 0.0, 0.0]\n";
    CameraStream stream = make();
    run(stream, 0.5);
    CameraStream::Info info;
    ASSERT_TRUE(stream.info_since(0, info));
    ASSERT_TRUE(info.calibration) << stream.report().detail;
    EXPECT_DOUBLE_EQ(info.calibration->fx_px, 500.0);
    EXPECT_DOUBLE_EQ(info.calibration->cx_px, 319.5);
    EXPECT_DOUBLE_EQ(info.calibration->distortion[0], 0.1);
}

TEST_F(CameraStreamTest, WrongCalibrationFileIsSaidWithItsBound) {
    const auto file = camera_.scratch() / (std::string(kSerial) + ".toml");
    const auto says = [&](const std::string& text) {
        std::ofstream(file) << text;
        CameraStream stream = make();
        newest_us_ = 0, sequence_ = -1;
        run(stream, 0.5);
        return stream.report().detail;
    };
    EXPECT_THAT(says("width_px = 640\nheight_px = 480\nfx_px = -3.0\nfy_px = 1.0\ncx_px = 1.0\ncy_px = 1.0\n"),
                HasSubstr("fx_px is out of [0.001, 1e+06]"));
    EXPECT_THAT(says("width_px = 640\nheight_px = 360\nfx_px = 3.0\nfy_px = 1.0\ncx_px = 1.0\ncy_px = 1.0\n"),
                HasSubstr("another aspect ratio"));
    EXPECT_THAT(says("width_px = \n"), HasSubstr(".toml:1"));
    EXPECT_THAT(says("width_px = 640\n"), HasSubstr("height_px is missing"));
}

TEST_F(CameraStreamTest, ControlsAreSetAndARefusedOneIsSaid) {
    controls = {{"gain_analogue", 77}, {"no_such", 1}};
    CameraStream stream = make();
    EXPECT_GT(run(stream, 1.0), 20);
    EXPECT_EQ(camera_.gain, 77);
    EXPECT_THAT(stream.report().detail, HasSubstr("no control no_such"));
}

TEST(ParseControls, TakesNamesWithIntegersOnly) {
    const auto good = parse_controls(" gain=16,exposure_time_absolute = -3 ,");
    ASSERT_TRUE(good);
    EXPECT_EQ(*good, (std::vector<std::pair<std::string, std::int64_t>>{{"gain", 16}, {"exposure_time_absolute", -3}}));
    for (const char* bad : {"gain", "gain=", "gain=1.5", "=3", "gain=99999999999999999999", "gain=1 2"})
        EXPECT_FALSE(parse_controls(bad)) << bad;
}

}  // namespace
}  // namespace teres
