// The service as the service manager sees it: ready, alive, stopping; ends on SIGTERM or with the recording.
#include "core/service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "core/log_reader.h"
#include "teres/health_t.hpp"
#include "tests/core/plugins/test_plugins.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::StartsWith;

// Stands in for systemd: a datagram socket that collects what the service says.
class FakeManager {
  public:
    FakeManager() {
        const std::string path = (scratch_.path() / "notify").string();
        socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        path.copy(address.sun_path, sizeof(address.sun_path) - 1);
        EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
        setenv("NOTIFY_SOCKET", path.c_str(), 1);
    }
    /// Reads all the time, as systemd does.
    void listen() {
        reader_ = std::thread([this] {
            while (!done_) {
                collect();
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            }
        });
    }
    void finish() {
        done_ = true;
        if (reader_.joinable()) reader_.join();
        collect();
    }
    ~FakeManager() {
        finish();
        unsetenv("NOTIFY_SOCKET");
        unsetenv("WATCHDOG_USEC");
        close(socket_);
    }
    void collect() {
        char text[4096];
        for (ssize_t size; (size = recv(socket_, text, sizeof(text), 0)) > 0;)
            said.emplace_back(text, static_cast<std::size_t>(size));
    }
    std::int64_t count(const std::string& word) const { return std::count(said.begin(), said.end(), word); }
    std::vector<std::string> said;

  private:
    test::ScratchFolder scratch_;
    int socket_ = -1;
    std::atomic<bool> done_{false};
    std::thread reader_;
};

Config config_of(const std::string& service, const std::string& rest) {
    const std::string text = "[service]\nplugin_folder = \"" + test::plugin_folder().string() +
                             "\"\ndrivers = [\"ramp\"]\nplugins = [\"echo\"]\n" + service + rest;
    auto config = Config::parse(text, "test.toml", "/nowhere");
    EXPECT_TRUE(config) << config.error().text;
    return *config;
}

TEST(Service, SaysReadyThenStoppingAndEndsWithTheRecording) {
    FakeManager manager;
    manager.listen();
    const std::atomic<bool> never{false};
    const Status status = run_service(config_of("", "[ramp]\nframes = 30\n"), never);
    EXPECT_TRUE(status) << status.error().text;
    manager.finish();
    ASSERT_GE(manager.said.size(), 4u);
    EXPECT_EQ(manager.said.front(), "STATUS=loading units");
    EXPECT_EQ(manager.said[1], "READY=1\nSTATUS=running");
    EXPECT_THAT(manager.said, Contains(StartsWith("STATUS=up ")));
    EXPECT_EQ(manager.said.back(), "STOPPING=1");
    EXPECT_EQ(manager.count("WATCHDOG=1"), 0) << "nobody asked for it";
}

TEST(Service, EndsOnSigtermWithinOneWait) {
    StopSignals signals;
    std::thread sender([] {
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
        kill(getpid(), SIGTERM);
    });
    const auto begin = std::chrono::steady_clock::now();
    const Status status =
        run_service(config_of("idle_wait_ms = 20\n", "[ramp]\nendless = true\nperiod_ms = 5\n"), signals.stop());
    const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    sender.join();
    EXPECT_TRUE(status) << status.error().text;
    EXPECT_GE(took_s, 0.29);
    EXPECT_LT(took_s, 10.0);
}

TEST(Service, RunsOnAfterTheRecordingIfAsked) {
    StopSignals signals;
    std::thread sender([] {
        std::this_thread::sleep_for(std::chrono::milliseconds(400));
        kill(getpid(), SIGINT);
    });
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_TRUE(run_service(config_of("stop_when_finished = false\n", "[ramp]\nframes = 5\n"), signals.stop()));
    sender.join();
    EXPECT_GE(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(390));
}

// WATCHDOG_USEC 200 ms: a ping every 50 ms from the loop, well below half of the limit.
TEST(Service, PingsTheWatchdogFromTheLoop) {
    FakeManager manager;
    manager.listen();
    setenv("WATCHDOG_USEC", "200000", 1);
    const std::atomic<bool> never{false};
    ASSERT_TRUE(run_service(config_of("", "[ramp]\nframes = 100\nperiod_ms = 10\n"), never));
    manager.finish();
    // At least 1 s of frames: 20 pings when the machine keeps up, at least one per limit if it is heavily
    // loaded.
    EXPECT_GE(manager.count("WATCHDOG=1"), 5);
    EXPECT_LE(manager.count("WATCHDOG=1"), 400);
}

TEST(Service, WatchdogCanBeSwitchedOff) {
    FakeManager manager;
    manager.listen();
    setenv("WATCHDOG_USEC", "200000", 1);
    const std::atomic<bool> never{false};
    ASSERT_TRUE(run_service(config_of("watchdog = false\n", "[ramp]\nframes = 50\nperiod_ms = 5\n"), never));
    manager.finish();
    EXPECT_EQ(manager.count("WATCHDOG=1"), 0);
}

// The kernel queues about ten datagrams (net.unix.max_dgram_qlen); more than that would block sd_notify(3)
// for good.
TEST(Service, ManagerThatDoesNotReadDoesNotHoldTheLoopUp) {
    FakeManager deaf;
    setenv("WATCHDOG_USEC", "4000", 1);
    const std::atomic<bool> never{false};
    const auto begin = std::chrono::steady_clock::now();
    ASSERT_TRUE(run_service(config_of("", "[ramp]\nframes = 600\nperiod_ms = 2\n"), never));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
    deaf.finish();
    EXPECT_GE(deaf.count("READY=1\nSTATUS=running"), 1);
    EXPECT_LT(deaf.count("WATCHDOG=1"), 600);
}

TEST(Service, FailedUnitEndsIt) {
    const std::atomic<bool> never{false};
    Config config = config_of("", "[ramp]\nendless = true\nperiod_ms = 1\n");
    ASSERT_TRUE(config.set("service.plugins=echo,thrower"));
    const Status status = run_service(config, never);
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, ErrorKind::kHostFault);
    EXPECT_EQ(status.error().text, "unit thrower failed while running");
}

TEST(Service, HealthComesWithItsPeriodAndTheLastWordIsRecorded) {
    test::ScratchFolder scratch;
    const auto file = scratch.path() / "run.lcm";
    const std::atomic<bool> never{false};
    ASSERT_TRUE(run_service(config_of("health_period_s = 0.2\nrecord_to = \"" + file.string() + "\"\n",
                                      "[ramp]\nframes = 100\nperiod_ms = 10\n"),
                            never));
    auto reader = LogReader::open(file);
    ASSERT_TRUE(reader) << reader.error().text;
    std::vector<health_t> health;
    health_t message;
    for (LogEvent event; reader->next(event);)
        if (event.channel == "HEALTH" && message.decode(event.data.data(), 0, static_cast<int>(event.data.size())) >= 0)
            health.push_back(message);
    // One at once, one every 0.2 s of at least 1 s, one at the end; fewer when the machine is loaded.
    ASSERT_GE(health.size(), 4u);
    for (std::size_t i = 0; i < health.size(); ++i)
        EXPECT_EQ(health[i].header.sequence, static_cast<std::int64_t>(i) + 1);
    for (std::size_t i = 1; i + 1 < health.size(); ++i)
        EXPECT_GE(health[i].header.capture_stamp_us - health[i - 1].header.capture_stamp_us, 190'000);
    EXPECT_EQ(health.back().units.at(0).state, "finished");
    EXPECT_EQ(health[health.size() / 2].units.at(0).state, "streaming");
    EXPECT_NEAR(health[health.size() / 2].channels.at(1).rate_hz, 100.0, 60.0);
}

}  // namespace
}  // namespace teres
