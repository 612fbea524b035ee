// The replay driver as the host sees it: through the plugin's C entry.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>

#include "core/case/case_writer.h"
#include "core/extensions/stream_clock.h"
#include "core/recorder.h"
#include "teres/markers_t.hpp"
#include "teres/tool_loads_t.hpp"
#include "tests/support/fake_host.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
using Bytes = std::vector<std::uint8_t>;
using test::FakeHost;
using test::HostedForTest;

template <class Message>
Message decoded(const test::Published& published) {
    Message message;
    EXPECT_GT(message.decode(published.data.data(), 0, static_cast<int>(published.data.size())), 0)
        << published.channel;
    return message;
}

bool same_bits(double a, double b) {
    return std::memcmp(&a, &b, sizeof a) == 0 || (std::isnan(a) && std::isnan(b));
}

// A block of our own making: frames that do not fall on the samples of the loads, a lost marker, a tool that
// lets go.
Case small_case() {
    test::BlockOptions options;
    options.cells = {2, 1, 1};
    options.frames = 5;
    options.dt_s = 0.02;
    options.motion = [](const Point& p, double t_s) -> Point {
        return {p[0] + 0.1 / 3.0 * t_s, p[1], p[2] - t_s * t_s / 7.0};
    };
    Case c = test::clamped_block(options);
    c.observations[9].position_m = {kNaN, kNaN, kNaN};
    c.loads = {{0.0, 0, {0.0, 0.0, -1.0}}, {0.05, 0, {1.0, 0.0, -1.0}}, {0.07, 0, {1.0, 3.0, -2.0}}};
    c.tools = {{"grasper", 1, 100.0}};
    c.tool_samples = {{0.02, 0, {0.0, 0.0, 0.1}}, {0.04, 0, {0.1, 0.0, 0.2}}, {0.06, 0, {kNaN, kNaN, kNaN}}};
    return c;
}

class ReplayTest : public testing::Test {
  protected:
    std::filesystem::path folder() const { return scratch_.path(); }
    std::filesystem::path write(const Case& c) {
        const auto to = folder() / "case";
        const Status status = write_case(c, to);
        EXPECT_TRUE(status) << status.error().text;
        return to;
    }
    using Settings = std::map<std::string, std::string>;
    std::string configure(HostedForTest& unit, const Settings& settings) {
        std::vector<teres_setting_value> values;
        for (const auto& [key, text] : settings) {
            const bool number = key == "speed" || key == "loop";
            values.push_back({key.c_str(), text.c_str(), number ? std::stod(text) : 0.0,
                              number ? TERES_SETTING_NUMBER : TERES_SETTING_TEXT});
        }
        return unit.configure(values);
    }
    // Plays to the end (at most `max_steps`).
    void play(FakeHost& host, Settings settings, int max_steps = 100'000) {
        settings.try_emplace("speed", "0");
        HostedForTest unit("replay", host);
        ASSERT_EQ(configure(unit, settings), "");
        ASSERT_EQ(unit.start(), "");
        int steps = 0;
        while (steps < max_steps && unit.step() != TERES_STEP_FINISHED) ++steps;
        unit.stop();
    }
    std::string error_of(const Settings& settings) {
        FakeHost host;
        HostedForTest unit("replay", host);
        return configure(unit, settings);
    }

  private:
    test::ScratchFolder scratch_;
};

TEST_F(ReplayTest, CaseGivesExactlyTheNumbersOfItsCsv) {
    const auto at = write(small_case());
    FakeHost host;
    play(host, {{"case", at}});

    std::ifstream csv(at / "observations.csv");
    std::string line;
    std::getline(csv, line);
    ASSERT_EQ(line, "t_s,marker_id,x_m,y_m,z_m");
    std::size_t rows = 0, lost = 0;
    for (const auto& published : host.published) {
        if (published.channel != "MARKERS") continue;
        const auto markers = decoded<markers_t>(published);
        for (std::size_t i = 0; i < static_cast<std::size_t>(markers.num_markers); ++i) {
            ASSERT_TRUE(std::getline(csv, line));
            std::stringstream fields(line);
            std::vector<double> number;
            for (std::string field; std::getline(fields, field, ',');)
                number.push_back(std::strtod(field.c_str(), nullptr));
            ASSERT_EQ(number.size(), 5u);
            EXPECT_EQ(markers.header.capture_stamp_us, std::llround(number[0] * 1e6));
            EXPECT_EQ(markers.marker_id[i], static_cast<int>(number[1]));
            EXPECT_TRUE(same_bits(markers.x_m[i], number[2])) << line;
            EXPECT_TRUE(same_bits(markers.y_m[i], number[3])) << line;
            EXPECT_TRUE(same_bits(markers.z_m[i], number[4])) << line;
            EXPECT_EQ(markers.sigma_m[i], 3e-4);
            lost += std::isnan(number[2]) ? 1 : 0;
            ++rows;
        }
    }
    EXPECT_EQ(rows, 40u);
    EXPECT_EQ(lost, 1u);
    EXPECT_FALSE(std::getline(csv, line));
}

TEST_F(ReplayTest, LoadsComeBeforeTheMarkersOfTheirFrame) {
    FakeHost host;
    play(host, {{"case", write(small_case())}});
    ASSERT_EQ(host.published.size(), 10u);
    for (std::size_t frame = 0; frame < 5; ++frame) {
        ASSERT_EQ(host.published[2 * frame].channel, "TOOL_LOADS");
        ASSERT_EQ(host.published[2 * frame + 1].channel, "MARKERS");
        const auto loads = decoded<tool_loads_t>(host.published[2 * frame]);
        const auto markers = decoded<markers_t>(host.published[2 * frame + 1]);
        EXPECT_EQ(loads.header.capture_stamp_us, static_cast<std::int64_t>(20'000 * frame));
        EXPECT_EQ(markers.header.capture_stamp_us, loads.header.capture_stamp_us);
        EXPECT_EQ(markers.header.sequence, static_cast<std::int64_t>(frame));
        EXPECT_EQ(loads.header.sequence, static_cast<std::int64_t>(frame));
        EXPECT_EQ(markers.header.frame_id, "clamped block");
    }
}

// By hand, frames at 0, 20, 40, 60, 80 ms: fx = t/50 ms until 50 ms; fy, fz between 50 and 70 ms; then the
// last sample holds.
TEST_F(ReplayTest, LoadsAndToolsAreInterpolatedLinearly) {
    FakeHost host;
    play(host, {{"case", write(small_case())}});
    const double fx[] = {0.0, 0.4, 0.8, 1.0, 1.0}, fy[] = {0.0, 0.0, 0.0, 1.5, 3.0},
                 fz[] = {-1.0, -1.0, -1.0, -1.5, -2.0};
    const double tool_x[] = {0.0, 0.0, 0.1, kNaN, kNaN};
    for (std::size_t frame = 0; frame < 5; ++frame) {
        const auto loads = decoded<tool_loads_t>(host.published[2 * frame]);
        EXPECT_EQ(loads.region, std::vector<std::string>{"tip"});
        EXPECT_EQ(loads.tool, std::vector<std::string>{"grasper"});
        EXPECT_NEAR(loads.fx_n[0], fx[frame], 1e-12) << frame;
        EXPECT_NEAR(loads.fy_n[0], fy[frame], 1e-12) << frame;
        EXPECT_NEAR(loads.fz_n[0], fz[frame], 1e-12) << frame;
        if (std::isnan(tool_x[frame]))
            EXPECT_TRUE(std::isnan(loads.x_m[0])) << frame;
        else
            EXPECT_NEAR(loads.x_m[0], tool_x[frame], 1e-12) << frame;
    }
}

TEST_F(ReplayTest, EveryRunPublishesTheSameBits) {
    const auto at = write(small_case());
    FakeHost first, second;
    play(first, {{"case", at}});
    play(second, {{"case", at}, {"speed", "50"}});
    EXPECT_EQ(first.hash(), second.hash());
    // Golden: changes only if the meaning of a case folder or of the messages changes on purpose.
    EXPECT_EQ(first.hash(), "df5fd9f7f619e9fa");
}

TEST_F(ReplayTest, RealTimeTakesTheTimeOfTheRecording) {
    const auto at = write(small_case());
    const auto start = std::chrono::steady_clock::now();
    FakeHost host;
    play(host, {{"case", at}, {"speed", "2"}}, 1'000'000'000);
    const auto took = std::chrono::steady_clock::now() - start;  // 80 ms at twice the speed
    EXPECT_GE(took, std::chrono::milliseconds(40));
    EXPECT_LT(took, std::chrono::seconds(5));
    EXPECT_EQ(host.published.size(), 10u);
}

TEST_F(ReplayTest, ItsClockIsThatOfTheRecording) {
    FakeHost host;
    HostedForTest unit("replay", host);
    Case c = small_case();
    for (auto& o : c.observations) o.t_s += 7.0;
    ASSERT_EQ(configure(unit, {{"case", write(c)}, {"speed", "0"}}), "");
    ASSERT_EQ(unit.start(), "");
    const auto* clock = static_cast<const StreamClock*>(unit.extension(StreamClock::kId));
    ASSERT_NE(clock, nullptr);
    EXPECT_EQ(clock->now_us(), 7'000'000);
    while (unit.step() != TERES_STEP_FINISHED) {
    }
    EXPECT_EQ(clock->now_us(), 7'080'000);
    EXPECT_EQ(unit.step(), TERES_STEP_FINISHED);
}

TEST_F(ReplayTest, LoopGoesOnInTimeAndNumber) {
    FakeHost host;
    play(host, {{"case", write(small_case())}, {"loop", "1"}}, 19);
    ASSERT_EQ(host.published.size(), 19u);
    const auto before = decoded<markers_t>(host.published[9]), after = decoded<markers_t>(host.published[11]);
    EXPECT_EQ(after.header.capture_stamp_us - before.header.capture_stamp_us, 20'000);
    EXPECT_EQ(after.header.sequence, 5);
    EXPECT_EQ(after.x_m, decoded<markers_t>(host.published[1]).x_m);
}

TEST_F(ReplayTest, RefusedMessageIsOfferedAgain) {
    const auto at = write(small_case());
    FakeHost host, undisturbed;
    host.refuse = 3;
    play(host, {{"case", at}});
    play(undisturbed, {{"case", at}});
    EXPECT_EQ(host.hash(), undisturbed.hash());
}

// ---- logs ----

struct Recorded {
    std::string channel;
    Bytes data;
    std::int64_t stamp_us;
};

void record(const std::filesystem::path& file, const std::vector<Recorded>& messages) {
    auto recorder = Recorder::open({.file = file, .overwrite = true});
    ASSERT_TRUE(recorder) << recorder.error().text;
    for (const auto& m : messages) ASSERT_TRUE(recorder->record(m.channel, m.data, m.stamp_us));
}

Recorded marker_message(std::int64_t capture_us, std::int64_t sequence, std::int64_t stamp_us) {
    markers_t m;
    m.header.capture_stamp_us = capture_us;
    m.header.sequence = sequence;
    m.num_markers = 1;
    m.marker_id = {3};
    m.x_m = m.y_m = m.z_m = m.sigma_m = {0.5};
    Bytes data(static_cast<std::size_t>(m.getEncodedSize()));
    m.encode(data.data(), 0, static_cast<int>(data.size()));
    return {"MARKERS", data, stamp_us};
}

TEST_F(ReplayTest, LogKeepsBytesAndOrderOfEveryChannel) {
    const auto file = folder() / "a.lcmlog";
    std::vector<Recorded> messages;
    for (int i = 0; i < 30; ++i) {
        messages.push_back(
            {"CAMERA_COLOR", Bytes(static_cast<std::size_t>(i * 1000), static_cast<std::uint8_t>(i)), 1000 * i});
        messages.push_back(marker_message(1000 * i, i, 1000 * i + 1));
        messages.push_back({"SOMEBODYS", Bytes(3, 9), 1000 * i + 2});
    }
    record(file, messages);
    FakeHost host;
    play(host, {{"log", file}});
    ASSERT_EQ(host.published.size(), messages.size());
    for (std::size_t i = 0; i < messages.size(); ++i) {
        EXPECT_EQ(host.published[i].channel, messages[i].channel);
        EXPECT_EQ(host.published[i].data, messages[i].data);
    }
    EXPECT_EQ(host.log_text, "");
}

TEST_F(ReplayTest, LogLeavesOutWhatThePluginsPublishThemselves) {
    const auto file = folder() / "a.lcmlog";
    record(
        file,
        {marker_message(0, 0, 0), {"BOUNDARY_ESTIMATE", Bytes(8), 1}, {"HEALTH", Bytes(8), 2}, {"PEDAL", Bytes(8), 3}});
    FakeHost host;
    play(host, {{"log", file}});
    ASSERT_EQ(host.published.size(), 2u);
    EXPECT_EQ(host.published[1].channel, "PEDAL");
    FakeHost chosen;
    play(chosen, {{"log", file}, {"channels", "B.*"}, {"skip_channels", ""}});
    ASSERT_EQ(chosen.published.size(), 1u);
    EXPECT_EQ(chosen.published[0].channel, "BOUNDARY_ESTIMATE");
}

TEST_F(ReplayTest, TimeGoingBackwardsIsPlayedAndReported) {
    const auto file = folder() / "a.lcmlog";
    record(file, {marker_message(0, 0, 2'000'000), marker_message(1, 1, 1'000'000), marker_message(2, 2, 1'000'100)});
    FakeHost host;
    play(host, {{"log", file}, {"speed", "1"}}, 1'000'000'000);
    EXPECT_EQ(host.published.size(), 3u);
    EXPECT_NE(host.log_text.find("time goes backwards 1 times"), std::string::npos) << host.log_text;
}

TEST_F(ReplayTest, CutLogIsPlayedToTheCutAndReported) {
    const auto file = folder() / "a.lcmlog";
    record(file, {marker_message(0, 0, 0), marker_message(1, 1, 1)});
    const auto size = std::filesystem::file_size(file);
    std::filesystem::resize_file(file, size - 5);
    FakeHost host;
    play(host, {{"log", file}});
    EXPECT_EQ(host.published.size(), 1u);
    EXPECT_NE(host.log_text.find("cut off at byte " + std::to_string(size / 2)), std::string::npos) << host.log_text;
}

TEST_F(ReplayTest, LoopedLogGoesOnInTimeAndNumber) {
    const auto file = folder() / "a.lcmlog";
    record(file, {marker_message(100, 4, 0), marker_message(200, 5, 100), marker_message(300, 6, 200)});
    FakeHost host;
    play(host, {{"log", file}, {"loop", "1"}}, 9);
    ASSERT_EQ(host.published.size(), 9u);
    for (std::size_t i = 0; i < 9; ++i) {
        const auto m = decoded<markers_t>(host.published[i]);
        EXPECT_EQ(m.header.sequence, static_cast<std::int64_t>(4 + i));
        EXPECT_EQ(m.header.capture_stamp_us, static_cast<std::int64_t>(100 + 100 * i));
        EXPECT_EQ(m.x_m[0], 0.5);
    }
}

// case.json's `stream` replaces observations.csv; the case's loads stand in where the log has none.
TEST_F(ReplayTest, StreamOfACaseReplacesItsObservations) {
    Case c = small_case();
    c.stream = "session.lcmlog";
    c.observations.clear();
    const auto at = write(c);
    record(at / "session.lcmlog", {marker_message(20'000, 0, 5'000'000), marker_message(60'000, 1, 5'040'000)});
    FakeHost host;
    play(host, {{"case", at}});
    ASSERT_EQ(host.published.size(), 4u);
    const double fx[] = {0.4, 1.0};
    for (std::size_t i = 0; i < 2; ++i) {
        ASSERT_EQ(host.published[2 * i].channel, "TOOL_LOADS");
        const auto loads = decoded<tool_loads_t>(host.published[2 * i]);
        EXPECT_NEAR(loads.fx_n[0], fx[i], 1e-12);
        EXPECT_EQ(loads.header.sequence, static_cast<std::int64_t>(i));
        EXPECT_EQ(host.published[2 * i + 1].channel, "MARKERS");
    }
}

TEST_F(ReplayTest, LoadsOfTheLogWinOverThoseOfTheCase) {
    const auto at = write(small_case());
    const auto file = folder() / "a.lcmlog";
    record(file, {{"TOOL_LOADS", Bytes(8), 0}, marker_message(0, 0, 1)});
    FakeHost host;
    play(host, {{"case", at}, {"log", file}});
    ASSERT_EQ(host.published.size(), 2u);
    EXPECT_EQ(host.published[0].data, Bytes(8));
}

TEST_F(ReplayTest, RefusesWhatCannotBePlayed) {
    EXPECT_NE(error_of({}).find("nothing to play"), std::string::npos);
    EXPECT_NE(error_of({{"case", folder() / "none"}}).find("none"), std::string::npos);
    EXPECT_NE(error_of({{"log", folder() / "none"}}).find("No such file"), std::string::npos);
    const auto file = folder() / "a.lcmlog";
    record(file, {{"HEALTH", Bytes(8), 0}});
    EXPECT_NE(error_of({{"log", file}}).find("no event on the channels '.*' without"), std::string::npos);
    EXPECT_NE(error_of({{"log", file}, {"channels", "("}}).find("'('"), std::string::npos);
    Case c = small_case();
    c.observations.clear();
    EXPECT_NE(error_of({{"case", write(c)}}).find("observations.csv"), std::string::npos);
}

}  // namespace
}  // namespace teres
