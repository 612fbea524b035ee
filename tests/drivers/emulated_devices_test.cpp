// Level 2: the built `teres run` against emulated devices (umockdev) with faults in mid-stream. What counts is what
// stands in its recording.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <fstream>
#include <functional>
#include <set>

#include "core/log_reader.h"
#include "teres/camera_info_t.hpp"
#include "teres/device_health_t.hpp"
#include "teres/image_t.hpp"
#include "teres/pedal_t.hpp"
#include "tests/support/emulated_devices.h"
#include "tests/support/program.h"

namespace teres {
namespace {

using test::EmulatedCamera;
using test::EmulatedFootswitch;
using testing::HasSubstr;

void wait_s(double s) {
    std::this_thread::sleep_for(std::chrono::duration<double>(s));
}

// Waits for a condition, at most ten seconds: the machine may be busy.
bool comes(const std::function<bool()>& condition) {
    for (int i = 0; i < 1000; ++i) {
        if (condition()) return true;
        wait_s(0.01);
    }
    return false;
}

struct Recording {
    std::vector<image_t> depth;
    std::vector<camera_info_t> info;
    std::vector<device_health_t> health;
    std::vector<pedal_t> pedal;

    explicit Recording(const std::filesystem::path& file) {
        auto log = LogReader::open(file);
        EXPECT_TRUE(log) << log.error().text;
        if (!log) return;
        for (LogEvent event; log->next(event);) {
            keep("CAMERA_DEPTH", event, depth);
            keep("CAMERA_DEPTH_INFO", event, info);
            keep("DEVICE_HEALTH", event, health);
            keep("PEDAL", event, pedal);
        }
        EXPECT_TRUE(log->damage().none()) << log->damage_text();
    }
    template <class Message>
    static void keep(const char* channel, const LogEvent& event, std::vector<Message>& to) {
        if (event.channel != channel) return;
        Message message;
        ASSERT_GT(message.decode(event.data.data(), 0, static_cast<int>(event.data.size())), 0);
        to.push_back(std::move(message));
    }
    /// States in their order, repetitions left out.
    std::string states() const {
        std::string text, last;
        for (const device_health_t& h : health)
            if (h.state != last) text += (text.empty() ? "" : " ") + (last = h.state);
        return text;
    }
    bool says(const std::string& what) const {
        for (const device_health_t& h : health)
            if (h.detail.find(what) != std::string::npos) return true;
        return false;
    }
};

class EmulatedDevices : public testing::Test {
  protected:
    void SetUp() override {
        const char* preload = std::getenv("LD_PRELOAD");
        if (preload == nullptr || std::string(preload).find("umockdev") == std::string::npos)
            GTEST_SKIP() << "SKIPPED LOUDLY: not below umockdev-wrapper";
        testbed_ = umockdev_testbed_new();
    }
    void TearDown() override {
        if (child_ > 0) kill(child_, SIGKILL);
        if (testbed_ != nullptr) g_object_unref(testbed_);
    }
    void start(const std::string& units, const std::string& settings = "") {
        const auto file = scratch_.path() / "test.toml";
        std::ofstream(file) << "[service]\ndrivers = [" << units << "]\nplugins = []\nrecord_to = \"" << log().string()
                            << "\"\n[camera]\ndepth_device = \"SN42\"\ndepth_width_px = 320\ndepth_height_px = 240\n"
                               "step_after_s = 0.3\nretry_after_s = 1\n"
                            << settings;
        const std::string program = test::program_path("teres").string(), config = file.string();
        std::string words[] = {program, "run", "--config", config};
        char* argv[] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(), nullptr};
        posix_spawn_file_actions_t files;
        posix_spawn_file_actions_init(&files);
        posix_spawn_file_actions_addopen(&files, 2, (scratch_.path() / "err").c_str(), O_WRONLY | O_CREAT, 0600);
        ASSERT_EQ(posix_spawn(&child_, program.c_str(), &files, nullptr, argv, environ), 0);
        posix_spawn_file_actions_destroy(&files);
    }
    Recording stop() {
        kill(child_, SIGTERM);
        int status = 0;
        waitpid(child_, &status, 0);
        child_ = -1;
        std::ifstream err(scratch_.path() / "err");
        const std::string said{std::istreambuf_iterator<char>(err), {}};
        EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << said;
        return Recording(log());
    }
    /// So many frames more have left the camera.
    bool frames(const EmulatedCamera& camera, int more) {
        const std::int64_t wanted = camera.frames + more;
        return comes([&] { return camera.frames >= wanted; });
    }
    std::filesystem::path log() const { return scratch_.path() / "run.lcm"; }

    test::ScratchFolder scratch_;
    UMockdevTestbed* testbed_ = nullptr;
    pid_t child_ = -1;
};

// Every frame is whole (its pixels count from 500 + the device's sequence), newer than the one before, never twice.
void check_frames(const Recording& recording) {
    std::int64_t newest_us = 0, sequence = -1;
    std::set<std::int64_t> stamps;
    for (const image_t& image : recording.depth) {
        ASSERT_EQ(image.num_bytes, static_cast<int>(EmulatedCamera::kFrameBytes));
        ASSERT_EQ(image.fourcc, "Z16 ");
        std::uint16_t first = 0, last = 0;
        std::memcpy(&first, image.data.data(), 2);
        std::memcpy(&last, image.data.data() + EmulatedCamera::kFrameBytes - 2, 2);
        EXPECT_EQ(last - first, EmulatedCamera::kWidth - 1) << "torn";
        EXPECT_GT(image.header.capture_stamp_us, newest_us);
        EXPECT_GT(image.header.sequence, sequence);
        newest_us = image.header.capture_stamp_us;
        sequence = image.header.sequence;
    }
}

class BufferMethods : public EmulatedDevices, public testing::WithParamInterface<std::uint32_t> {};

TEST_P(BufferMethods, FramesReachTheRecording) {
    EmulatedCamera camera(testbed_, GetParam());
    camera.plug("video0", "SN42");
    start("\"camera\"");
    ASSERT_TRUE(frames(camera, 30));
    const Recording recording = stop();
    EXPECT_EQ(camera.memory, GetParam());
    EXPECT_GT(recording.depth.size(), 20u);
    check_frames(recording);
    ASSERT_FALSE(recording.info.empty());
    EXPECT_EQ(recording.info[0].fx_px, 193.0);
    EXPECT_NEAR(recording.info[0].depth_unit_m, 0.0005, 1e-12);
    EXPECT_EQ(recording.states().substr(recording.states().size() - 9), "streaming");
}
INSTANTIATE_TEST_SUITE_P(Ways, BufferMethods, testing::Values(V4L2_MEMORY_MMAP, V4L2_MEMORY_USERPTR, 0u));

TEST_F(EmulatedDevices, CameraRecoversFromEveryFaultInMidStream) {
    EmulatedCamera camera(testbed_);
    camera.plug("video0", "SN42");
    start("\"camera\"");
    ASSERT_TRUE(frames(camera, 10));
    for (auto* fault : {&camera.dequeue_errors, &camera.short_frames, &camera.skipped_frames, &camera.flagged_frames,
                        &camera.repeated_frames}) {
        *fault = 1;
        ASSERT_TRUE(frames(camera, 6));
    }
    camera.short_frames = 8;  // more than the five in a row that end a stream
    ASSERT_TRUE(comes([&] { return camera.short_frames == 0; }));
    ASSERT_TRUE(frames(camera, 6));
    camera.hang_ms = 800;
    wait_s(0.9);
    ASSERT_TRUE(frames(camera, 10));
    const int streams = camera.streams;
    camera.silent = true;  // until it is reset
    ASSERT_TRUE(comes([&] { return camera.resets > 0; }));
    ASSERT_TRUE(frames(camera, 10));
    EXPECT_GE(camera.streams, streams + 2) << "restart and re-opening come before the reset";
    const Recording recording = stop();
    check_frames(recording);
    EXPECT_THAT(recording.states(), HasSubstr("streaming stale recovering"));
    EXPECT_EQ(recording.states().substr(recording.states().size() - 9), "streaming");
    EXPECT_GE(recording.health.back().damaged, 3 + 5);
    EXPECT_GE(recording.health.back().lost, 1);
    EXPECT_GE(recording.health.back().recoveries, 3);
    EXPECT_TRUE(recording.says("Input/output error") || recording.says("short frame"));
}

TEST_F(EmulatedDevices, UnpluggedCameraIsFoundAgainUnderAnotherNode) {
    EmulatedCamera camera(testbed_);
    camera.plug("video0", "SN42");
    start("\"camera\"");
    ASSERT_TRUE(frames(camera, 10));
    camera.unplug();
    wait_s(0.6);
    camera.plug("video0", "OTHER");
    const std::int64_t before = camera.frames;
    wait_s(0.6);
    EXPECT_EQ(camera.frames, before) << "another camera in its place";
    camera.unplug();
    camera.plug("video3", "SN42");
    const std::int64_t plugged_us = monotonic_us();
    ASSERT_TRUE(frames(camera, 10));
    const Recording recording = stop();
    check_frames(recording);
    EXPECT_THAT(recording.states(), testing::MatchesRegex(".*streaming.* absent recovering streaming"));
    EXPECT_EQ(recording.health.back().node, "/dev/video3");
    std::int64_t first_us = 0;
    for (const image_t& image : recording.depth)
        if (first_us == 0 && image.header.capture_stamp_us > plugged_us) first_us = image.header.capture_stamp_us;
    EXPECT_LT(first_us - plugged_us, 2'000'000);
}

TEST_F(EmulatedDevices, WrongFormatAndBusyCameraAreSaidUntilTheyPass) {
    EmulatedCamera camera(testbed_);
    camera.fourcc = V4L2_PIX_FMT_YUYV;
    camera.plug("video0", "SN42");
    start("\"camera\"");
    // A second request comes after what became of the first has been told.
    const auto asked_twice = [&] {
        return comes([&, from = camera.format_requests.load()] { return camera.format_requests >= from + 2; });
    };
    ASSERT_TRUE(asked_twice());
    camera.busy = true;
    ASSERT_TRUE(asked_twice());
    camera.busy = false;
    camera.fourcc = V4L2_PIX_FMT_Z16;
    ASSERT_TRUE(frames(camera, 10));
    const Recording recording = stop();
    EXPECT_TRUE(recording.says("the driver gives YUYV"));
    EXPECT_TRUE(recording.says("another program uses the camera"));
    EXPECT_EQ(camera.resets, 0);
    EXPECT_GT(recording.depth.size(), 5u);
}

TEST_F(EmulatedDevices, FootswitchComesGoesAndIsNeverLeftPressed) {
    EmulatedFootswitch footswitch(testbed_);
    start("\"pedal\"");
    wait_s(0.5);
    for (int round = 0; round < 2; ++round) {
        footswitch.plug();
        ASSERT_TRUE(comes([&] { return footswitch.report(1); }));
        ASSERT_TRUE(comes([&] { return footswitch.report(0); }));
        ASSERT_TRUE(comes([&] { return footswitch.report(4); }));
        wait_s(0.3);
        footswitch.unplug();
        wait_s(0.3);
    }
    const Recording recording = stop();
    std::string text;
    for (const pedal_t& pedal : recording.pedal) text += pedal.pedal + (pedal.down != 0 ? "+ " : "- ");
    EXPECT_EQ(text, "left+ left- right+ right- left+ left- right+ right- ");
    EXPECT_EQ(recording.pedal.front().action, "record");
    EXPECT_THAT(recording.states(), HasSubstr("streaming absent"));
}

}  // namespace
}  // namespace teres
