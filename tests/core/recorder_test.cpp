#include "core/recorder.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>
#include <vector>

#include "core/bus.h"
#include "core/log_reader.h"
#include "tests/support/private_network.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

struct Stored {
    std::string channel;
    Bytes data;
    std::int64_t stamp_us, number;
};

std::vector<Stored> read(const std::filesystem::path& file) {
    auto reader = LogReader::open(file);
    EXPECT_TRUE(reader) << reader.error().text;
    std::vector<Stored> events;
    LogEvent event;
    while (reader && reader->next(event))
        events.push_back(
            {std::string(event.channel), Bytes(event.data.begin(), event.data.end()), event.stamp_us, event.number});
    EXPECT_EQ(reader->damage_text(), "");
    return events;
}

Recorder open(const RecorderSettings& settings) {
    auto recorder = Recorder::open(settings);
    EXPECT_TRUE(recorder) << recorder.error().text;
    return std::move(*recorder);
}

class RecorderTest : public testing::Test {
  protected:
    std::filesystem::path file() const { return scratch_.path() / "x.lcmlog"; }

  private:
    test::ScratchFolder scratch_;
};

TEST_F(RecorderTest, WritesWhatItWasGivenInOrder) {
    {
        Recorder recorder = open({.file = file()});
        for (int i = 0; i < 100; ++i)
            EXPECT_TRUE(recorder.record(std::string(1, static_cast<char>('A' + i % 3)),
                                        Bytes(static_cast<std::size_t>(i), 5), 1000 + i));
    }
    const auto events = read(file());
    ASSERT_EQ(events.size(), 100u);
    for (std::size_t i = 0; i < 100; ++i) {
        EXPECT_EQ(events[i].channel, std::string(1, static_cast<char>('A' + i % 3)));
        EXPECT_EQ(events[i].data.size(), i);
        EXPECT_EQ(events[i].stamp_us, 1000 + static_cast<std::int64_t>(i));
        EXPECT_EQ(events[i].number, static_cast<std::int64_t>(i));
    }
}

TEST_F(RecorderTest, RefusesToOverwriteAndBadBounds) {
    open({.file = file()});
    EXPECT_NE(Recorder::open({.file = file()}).error().text.find("exists"), std::string::npos);
    EXPECT_TRUE(Recorder::open({.file = file(), .overwrite = true}));
    EXPECT_EQ(Recorder::open({.file = file(), .keep = 2}).error().kind, ErrorKind::kInvalidInput);
    EXPECT_EQ(Recorder::open({.file = "/does/not/exist/x"}).error().kind, ErrorKind::kHostFault);
    EXPECT_EQ(Recorder::open({}).error().kind, ErrorKind::kInvalidInput);
}

TEST_F(RecorderTest, SplitsAndKeepsTheNewest) {
    {
        Recorder recorder = open({.file = file(), .split_mb = 1, .keep = 2});
        for (int i = 0; i < 50; ++i) recorder.record("A", Bytes(100'000), i);
    }
    std::size_t total = 0;
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(file().parent_path())) {
        names.push_back(entry.path().filename());
        EXPECT_LE(std::filesystem::file_size(entry.path()), 1u << 20);
        total += read(entry.path()).size();
    }
    std::sort(names.begin(), names.end());
    EXPECT_EQ(names, (std::vector<std::string>{"x.lcmlog.03", "x.lcmlog.04"}));  // ten to a file
    EXPECT_EQ(total, 20u);
    EXPECT_EQ(read(file().string() + ".04").back().number, 49);
}

TEST_F(RecorderTest, StopsAtItsLimitWithWholeEventsAndCounts) {
    Recorder recorder = open({.file = file(), .max_mb = 1});
    for (int i = 0; i < 50; ++i) recorder.record("A", Bytes(100'000), i);
    recorder.flush();
    EXPECT_EQ(recorder.counters().written, 10);
    EXPECT_EQ(recorder.counters().dropped, 40);
    EXPECT_TRUE(recorder.counters().stopped);
    EXPECT_NE(recorder.stop_reason().find("1 MB"), std::string::npos);
    EXPECT_FALSE(recorder.record("A", Bytes(1), 1));
    EXPECT_EQ(read(file()).size(), 10u);
}

TEST_F(RecorderTest, FullDiskStopsTheRecordingOnly) {
    Recorder recorder = open({.file = "/dev/full", .overwrite = true});
    recorder.record("A", Bytes(100'000), 1);
    recorder.flush();
    EXPECT_TRUE(recorder.counters().stopped);
    EXPECT_EQ(recorder.counters().written, 0);
    EXPECT_EQ(recorder.counters().dropped, 1);
    EXPECT_NE(recorder.stop_reason().find("No space left"), std::string::npos) << recorder.stop_reason();
}

// The write that hits the end of the disk is partial; the log must still end with a whole event.
TEST_F(RecorderTest, DiskFullInTheMiddleOfAnEventLeavesASoundLog) {
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    rlimit limit = before;
    limit.rlim_cur = 250'000;
    const auto ignored = signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &limit);
    {
        Recorder recorder = open({.file = file()});
        for (int i = 0; i < 5; ++i) recorder.record("A", Bytes(100'000), i);
        recorder.flush();
        EXPECT_TRUE(recorder.counters().stopped);
        EXPECT_EQ(recorder.counters().written, 2);
        EXPECT_EQ(recorder.counters().dropped, 3);
    }
    setrlimit(RLIMIT_FSIZE, &before);
    signal(SIGXFSZ, ignored);
    EXPECT_EQ(read(file()).size(), 2u);
}

TEST_F(RecorderTest, FullQueueDropsAndCountsInsteadOfWaiting) {
    Recorder recorder = open({.file = file(), .queue_bytes = 1000});
    EXPECT_FALSE(recorder.record("A", Bytes(1001), 1));
    EXPECT_FALSE(recorder.record("", Bytes(1), 1));
    EXPECT_FALSE(recorder.record(std::string(64, 'A'), Bytes(1), 1));
    EXPECT_TRUE(recorder.record("A", Bytes(100), 1));
    recorder.flush();
    EXPECT_EQ(recorder.counters().dropped, 3);
    EXPECT_EQ(recorder.counters().written, 1);
    EXPECT_FALSE(recorder.counters().stopped);
}

TEST_F(RecorderTest, KilledProcessLosesNothingOlderThanASecond) {
    int ready[2];
    ASSERT_EQ(pipe(ready), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
        auto recorder = Recorder::open({.file = file()});
        for (int i = 0; i < 20; ++i) recorder->record("A", Bytes(1000), i);
        std::this_thread::sleep_for(1s);
        if (write(ready[1], "+", 1) != 1) _exit(1);
        for (;;) pause();
    }
    char mark = 0;
    ASSERT_EQ(::read(ready[0], &mark, 1), 1);
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    close(ready[0]);
    close(ready[1]);
    EXPECT_EQ(read(file()).size(), 20u);
}

TEST(RecorderClock, NeverRunsBackwards) {
    std::int64_t last = Recorder::wall_clock_us();
    for (int i = 0; i < 1000; ++i) {
        const std::int64_t now = Recorder::wall_clock_us();
        ASSERT_GE(now, last);
        last = now;
    }
    EXPECT_NEAR(static_cast<double>(last) * 1e-6, static_cast<double>(time(nullptr)), 5.0);
}

// ---- against the tools of LCM themselves, in a network namespace ----

pid_t start(const std::vector<std::string>& command) {
    const pid_t child = fork();
    if (child == 0) {
        std::vector<char*> arguments;
        for (const auto& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
        arguments.push_back(nullptr);
        execvp(arguments[0], arguments.data());
        _exit(127);
    }
    return child;
}

int stop(pid_t child, int signal_number) {
    if (signal_number != 0) kill(child, signal_number);
    int status = 0;
    waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

class LcmTools : public RecorderTest {
  protected:
    void SetUp() override { TERES_REQUIRE_PRIVATE_NETWORK(); }
    const std::string url_ = "--lcm-url=" + std::string(test::kLoopbackUrl);
};

TEST_F(LcmTools, LogplayerPlaysOurLog) {
    {
        Recorder recorder = open({.file = file()});
        for (int i = 0; i < 50; ++i)
            recorder.record(i % 2 != 0 ? "MARKERS" : "TOOL_LOADS",
                            Bytes(static_cast<std::size_t>(i + 1), static_cast<std::uint8_t>(i)), 1'000'000 + i * 1000);
    }
    auto bus = Bus::open(test::kLoopbackUrl);
    ASSERT_TRUE(bus) << bus.error().text;
    std::vector<Stored> heard;
    ASSERT_TRUE(
        bus->subscribe(".*", 1000, [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            heard.push_back({std::string(channel), Bytes(data.begin(), data.end()), 0, 0});
        }));
    const pid_t player = start({"lcm-logplayer", url_, file()});
    for (int i = 0; i < 300 && heard.size() < 50; ++i) bus->dispatch(10);
    EXPECT_EQ(stop(player, 0), 0);
    ASSERT_EQ(heard.size(), 50u);
    for (std::size_t i = 0; i < 50; ++i) {
        EXPECT_EQ(heard[i].channel, i % 2 != 0 ? "MARKERS" : "TOOL_LOADS");
        EXPECT_EQ(heard[i].data, Bytes(i + 1, static_cast<std::uint8_t>(i)));
    }
}

TEST_F(LcmTools, WeReadTheLogOfLcmLogger) {
    const pid_t logger = start({"lcm-logger", "-f", url_, file()});
    auto bus = Bus::open(test::kLoopbackUrl);
    ASSERT_TRUE(bus) << bus.error().text;
    // The logger needs a moment to listen: knock until its file grows.
    std::error_code ignored;
    for (int i = 0; i < 300 && (!std::filesystem::exists(file()) || std::filesystem::file_size(file(), ignored) == 0);
         ++i) {
        bus->publish("KNOCK", Bytes(5000));
        std::this_thread::sleep_for(10ms);
    }
    for (int i = 0; i < 50; ++i) {
        bus->publish("MARKERS", Bytes(static_cast<std::size_t>(i + 1), static_cast<std::uint8_t>(i)));
        std::this_thread::sleep_for(5ms);  // the logger queues 30 messages only
    }
    std::this_thread::sleep_for(500ms);
    stop(logger, SIGINT);
    std::vector<Stored> markers;
    for (auto& event : read(file()))
        if (event.channel == "MARKERS") markers.push_back(std::move(event));
    ASSERT_EQ(markers.size(), 50u);
    for (std::size_t i = 0; i < 50; ++i) EXPECT_EQ(markers[i].data, Bytes(i + 1, static_cast<std::uint8_t>(i)));
    EXPECT_NEAR(static_cast<double>(markers[0].stamp_us) * 1e-6, static_cast<double>(time(nullptr)), 60.0);
}

}  // namespace
}  // namespace teres
