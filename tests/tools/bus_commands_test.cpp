// teres record, spy and replay as a user runs them; record and spy in a network namespace of their own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "core/bus.h"
#include "core/case/case_writer.h"
#include "core/case/text_writer.h"
#include "core/log_reader.h"
#include "core/recorder.h"
#include "core/run_hash.h"
#include "teres/innovation_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/pedal_t.hpp"
#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using namespace std::chrono_literals;
using test::run_teres;
using ::testing::HasSubstr;
using ::testing::Not;
using Bytes = std::vector<std::uint8_t>;

template <class Message>
Bytes encoded(const Message& message) {
    Bytes data(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(data.data(), 0, static_cast<int>(data.size()));
    return data;
}

markers_t markers(std::int64_t sequence) {
    markers_t m;
    m.header.capture_stamp_us = 20'000 * sequence;
    m.header.sequence = sequence;
    m.header.frame_id = "case";
    m.num_markers = 1;
    m.marker_id = {3};
    m.x_m = {0.001 * static_cast<double>(sequence)};
    m.y_m = m.z_m = m.sigma_m = {0.0};
    return m;
}

std::string line_with(const std::string& text, const std::string& part) {
    std::stringstream lines(text);
    for (std::string line; std::getline(lines, line);)
        if (line.find(part) != std::string::npos) return line;
    return {};
}

// Publishes MARKERS every 5 ms (every tenth number is left out) until it goes out of scope.
class Publisher {
  public:
    Publisher()
        : thread_([this] {
              auto bus = Bus::open(test::kLoopbackUrl);
              for (std::int64_t i = 0; bus && !stop_; ++i) {
                  if (i % 10 != 9) bus->publish("MARKERS", encoded(markers(i)));
                  bus->publish("CAMERA_COLOR", Bytes(1000, 7));
                  std::this_thread::sleep_for(5ms);
              }
          }) {}
    ~Publisher() {
        stop_ = true;
        thread_.join();
    }

  private:
    std::atomic<bool> stop_ = false;
    std::thread thread_;
};

class BusCommands : public ::testing::Test {
  protected:
    void SetUp() override { TERES_REQUIRE_PRIVATE_NETWORK(); }
    std::filesystem::path file(const std::string& name) const { return scratch_.path() / name; }

  private:
    test::ScratchFolder scratch_;
};

TEST_F(BusCommands, SpyShowsRatesGapsAndFields) {
    const Publisher publisher;
    const auto run = run_teres({"spy", "--url", test::kLoopbackUrl, "--once", "--json"});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const auto json = nlohmann::json::parse(run.output);
    ASSERT_EQ(json["channels"].size(), 2u) << run.output;
    const auto& spied = json["channels"][1];
    EXPECT_EQ(spied["channel"], "MARKERS");
    EXPECT_EQ(spied["type"], "teres.markers_t");
    EXPECT_GT(spied["rate_hz"].get<double>(), 10.0);
    EXPECT_LT(spied["rate_hz"].get<double>(), 200.0);
    EXPECT_GT(spied["lost"].get<int>(), 0);
    EXPECT_EQ(spied["fields"]["marker_id"][0], 3);
    const auto lines =
        run_teres({"spy", "--url", test::kLoopbackUrl, "--seconds", "0.5", "--lines", "--channels", "MARKERS"});
    EXPECT_THAT(lines.output, ::testing::ContainsRegex("^[0-9.]+ MARKERS .*num_markers=.*\n[0-9.]+ MARKERS "));
    const auto table = run_teres({"spy", "--url", test::kLoopbackUrl, "--seconds", "1.2", "--channels", "CAMERA_.*"});
    EXPECT_EQ(table.exit_code, 0);
    EXPECT_THAT(table.output, HasSubstr("CAMERA_COLOR"));
    EXPECT_THAT(table.output, Not(HasSubstr("MARKERS")));
    EXPECT_THAT(table.output, Not(HasSubstr("\033")));  // not a terminal
}

TEST_F(BusCommands, SpyAndRecordSayThatNothingCame) {
    const auto spy = run_teres({"spy", "--url", test::kLoopbackUrl, "--once"});
    EXPECT_EQ(spy.exit_code, 1);
    EXPECT_THAT(spy.error, HasSubstr("no message on " + std::string(test::kLoopbackUrl)));
    const auto record = run_teres({"record", "--url", test::kLoopbackUrl, "--seconds", "0.3", "-o", file("none.lcm")});
    EXPECT_EQ(record.exit_code, 1);
    EXPECT_THAT(record.error, HasSubstr("no message"));
}

TEST_F(BusCommands, RecordWritesTheChosenChannels) {
    const Publisher publisher;
    const auto run = run_teres(
        {"record", "--url", test::kLoopbackUrl, "--seconds", "1", "--channels", "MARKERS", "-o", file("a.lcm")});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    auto reader = LogReader::open(file("a.lcm"));
    ASSERT_TRUE(reader) << reader.error().text;
    LogEvent event;
    std::int64_t count = 0, last = -1;
    while (reader->next(event)) {
        EXPECT_EQ(event.channel, "MARKERS");
        markers_t m;
        ASSERT_GT(m.decode(event.data.data(), 0, static_cast<int>(event.data.size())), 0);
        EXPECT_GT(m.header.sequence, last);
        last = m.header.sequence;
        ++count;
    }
    EXPECT_GT(count, 10);
    EXPECT_TRUE(reader->damage().none()) << reader->damage_text();
    EXPECT_THAT(run.error, HasSubstr(std::to_string(count) + " messages"));

    const auto again = run_teres({"record", "--url", test::kLoopbackUrl, "--seconds", "0.1", "-o", file("a.lcm")});
    EXPECT_EQ(again.exit_code, 2);
    EXPECT_THAT(again.error, HasSubstr("a.lcm: the file exists"));
    const auto full =
        run_teres({"record", "--url", test::kLoopbackUrl, "--seconds", "5", "--force", "-o", "/dev/full"});
    EXPECT_EQ(full.exit_code, 3);
    EXPECT_THAT(full.error, HasSubstr("No space left on device"));
}

TEST_F(BusCommands, PedalStartsAndStopsTheRecording) {
    const Publisher publisher;
    std::atomic<bool> stop = false;
    std::thread foot([&] {
        auto bus = Bus::open(test::kLoopbackUrl);
        pedal_t pedal{};
        pedal.pedal = "left";
        // Marks all the time; two steps on the pedal that records, a second apart, once the program surely listens.
        for (pedal.header.sequence = 0; bus && !stop; ++pedal.header.sequence) {
            pedal.down = 1;
            pedal.action = pedal.header.sequence == 30 || pedal.header.sequence == 40 ? "record" : "mark";
            bus->publish("PEDAL", encoded(pedal));
            std::this_thread::sleep_for(100ms);
        }
    });
    const auto run =
        run_teres({"record", "--url", test::kLoopbackUrl, "--pedal", "--seconds", "6", "-o", file("pedal.lcm")});
    stop = true;
    foot.join();
    EXPECT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.error, HasSubstr("recording to"));
    auto reader = LogReader::open(file("pedal.lcm"));
    ASSERT_TRUE(reader) << reader.error().text << run.error;
    int markers = 0, pedals = 0;
    for (LogEvent event; reader->next(event);) {
        markers += event.channel == "MARKERS" ? 1 : 0;
        pedals += event.channel == "PEDAL" ? 1 : 0;
    }
    EXPECT_GT(markers, 10);
    EXPECT_GE(pedals, 3) << "from one step to the next, marks between them";
    EXPECT_LE(pedals, 14) << "it went on after the second step";
}

TEST(BusCommandUsage, BadUrlsAndOptionsAreWrongUsage) {
    EXPECT_EQ(run_teres({"spy", "--url", "memq://"}).exit_code, 2);
    EXPECT_EQ(run_teres({"record", "--url", "memq://"}).exit_code, 2);
    EXPECT_EQ(run_teres({"spy", "--url", "http://x"}).exit_code, 2);
    EXPECT_EQ(run_teres({"record", "--split-mb", "-1"}).exit_code, 2);
    for (const char* verb : {"spy", "record", "replay"}) {
        const auto help = run_teres({verb, "--help"});
        EXPECT_EQ(help.exit_code, 0);
        EXPECT_THAT(help.output, HasSubstr("Examples:\n  teres " + std::string(verb)));
    }
}

// ---- replay, through the echo plugin of the host's tests: INNOVATION with nis = x_m[0] + 1e-9 now_us for
// each MARKERS ----

class ReplayCommand : public ::testing::Test {
  protected:
    void SetUp() override {
        test::BlockOptions options;
        options.cells = {2, 1, 1};
        options.frames = 6;
        options.dt_s = 0.02;
        options.motion = [](const Point& p, double t_s) -> Point { return {p[0] + t_s / 64.0, p[1], p[2]}; };
        case_ = test::clamped_block(options);
        ASSERT_TRUE(write_case(case_, case_folder()));
        const char* build = std::getenv("TERES_BUILD_DIR");
        const std::string plugins = std::string(build != nullptr ? build : ".") + "/lib/teres/test_plugins";
        ASSERT_TRUE(write_text_file(
            config(),
            "[service]\ndrivers = [\"replay\"]\nplugins = [\"echo\"]\nplugin_folder = \"" + plugins + "\"\n"));
    }
    std::filesystem::path file(const std::string& name) const { return scratch_.path() / name; }
    std::string case_folder() const { return file("case"); }
    std::string config() const { return file("test.toml"); }
    test::Run replay(const std::string& source, std::vector<std::string> more = {}) const {
        std::vector<std::string> arguments{"replay", source, "--config", config()};
        if (more.empty() || more.front() != "--speed") more.insert(more.end(), {"--speed", "0"});
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run_teres(arguments);
    }
    // What the plugin must have published, computed here.
    std::string expected_hash() const {
        RunHash hash;
        for (int frame = 0; frame < 6; ++frame) {
            innovation_t answer{};
            answer.header.capture_stamp_us = std::llround(frame * case_.dt_s * 1e6);
            answer.header.sequence = frame;
            answer.header.frame_id = case_.name;
            answer.nis = case_.observations[static_cast<std::size_t>(frame) * case_.markers.size()].position_m[0] +
                         1e-9 * static_cast<double>(answer.header.capture_stamp_us);
            answer.degrees_of_freedom = 1;
            answer.num_markers = 0;
            hash.add("INNOVATION", encoded(answer));
        }
        return hash.text();
    }
    Case case_;

  private:
    test::ScratchFolder scratch_;
};

TEST_F(ReplayCommand, HashIsThatOfWhatThePluginsMustPublish) {
    const auto first = replay(case_folder()), second = replay(case_folder());
    ASSERT_EQ(first.exit_code, 0) << first.error;
    EXPECT_EQ(line_with(first.output, "run hash"), "run hash: " + expected_hash());
    EXPECT_EQ(line_with(second.output, "run hash"), line_with(first.output, "run hash"));
    const auto real_time = replay(case_folder(), {"--speed", "5"});  // a busy machine may skip frames: no bits promised
    EXPECT_EQ(real_time.exit_code, 0) << real_time.error;
    EXPECT_THAT(real_time.output, HasSubstr("0.100 s of recording"));
    const auto other = replay(case_folder(), {"--set", "echo.rounds=1"});
    EXPECT_EQ(line_with(other.output, "run hash"), line_with(first.output, "run hash"));
    EXPECT_THAT(first.output, HasSubstr("0.100 s of recording"));
}

TEST_F(ReplayCommand, RecordedLogReplaysToTheSameBits) {
    const auto live = replay(case_folder(), {"--set", "service.record_to=" + file("run.lcm").string()});
    ASSERT_EQ(live.exit_code, 0) << live.error;
    const auto again = replay(file("run.lcm"));
    ASSERT_EQ(again.exit_code, 0) << again.error;
    EXPECT_EQ(line_with(again.output, "run hash"), line_with(live.output, "run hash"));
    EXPECT_EQ(line_with(again.output, "compared"),
              "compared with the log: INNOVATION 6 recorded, 6 replayed, 6 identical");
    // A frame fewer: the rest is not the same run.
    auto reader = LogReader::open(file("run.lcm"));
    auto shorter = Recorder::open({.file = file("shorter.lcm")});
    ASSERT_TRUE(reader && shorter);
    LogEvent event;
    for (int markers_seen = 0; reader->next(event);) {
        if (event.channel == "MARKERS" && ++markers_seen == 3) continue;
        ASSERT_TRUE(shorter->record(event.channel, event.data, event.stamp_us));
    }
    shorter->flush();
    const auto other = replay(file("shorter.lcm"));
    EXPECT_EQ(line_with(other.output, "compared"),
              "compared with the log: INNOVATION 6 recorded, 5 replayed, 2 identical");
    EXPECT_NE(line_with(other.output, "run hash"), line_with(live.output, "run hash"));
}

TEST_F(ReplayCommand, CutLogIsReplayedAndNamed) {
    ASSERT_EQ(replay(case_folder(), {"--set", "service.record_to=" + file("run.lcm").string()}).exit_code, 0);
    const auto size = std::filesystem::file_size(file("run.lcm"));
    std::filesystem::resize_file(file("run.lcm"), size - 3);
    const auto run = replay(file("run.lcm"));
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_THAT(run.error, HasSubstr("cut off at byte"));
}

TEST_F(ReplayCommand, WrongInputIsNamed) {
    const auto absent = replay(file("absent"));
    EXPECT_EQ(absent.exit_code, 2);
    EXPECT_THAT(absent.error, HasSubstr("absent is neither a case folder nor a log file"));
    ASSERT_TRUE(write_text_file(file("text.lcm"), "this is no log at all, but it is longer than one event header"));
    const auto text = replay(file("text.lcm"));
    EXPECT_EQ(text.exit_code, 2);
    EXPECT_THAT(text.error, HasSubstr("no event"));
    EXPECT_EQ(replay(case_folder(), {"--case", case_folder()}).exit_code, 2);
    EXPECT_EQ(replay(case_folder(), {"--speed", "-1"}).exit_code, 2);
}

}  // namespace
}  // namespace teres
