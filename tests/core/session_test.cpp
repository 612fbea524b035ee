// Units working together: life cycle, order, nothing lost, failures that stay with the unit.
#include "core/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "core/log_reader.h"
#include "teres/innovation_t.hpp"
#include "teres/markers_t.hpp"
#include "tests/core/plugins/life.h"
#include "tests/core/plugins/test_plugins.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

Config config_of(const std::string& drivers, const std::string& plugins, const std::string& rest = "") {
    const std::string text = "[service]\nplugin_folder = \"" + test::plugin_folder().string() + "\"\ndrivers = [" +
                             drivers + "]\nplugins = [" + plugins + "]\n" + rest;
    auto config = Config::parse(text, "test.toml", "/nowhere");
    EXPECT_TRUE(config) << config.error().text;
    return *config;
}

std::string open_error(const Config& config) {
    const auto session = Session::open(config);
    return session ? "" : session.error().text;
}

struct Answers {
    std::vector<std::int64_t> sequence;
    std::vector<double> nis;
};

Answers run_echo(const std::string& rest) {
    Answers answers;
    const auto session = Session::open(config_of("\"ramp\"", "\"echo\"", rest));
    EXPECT_TRUE(session) << session.error().text;
    if (!session) return answers;
    EXPECT_TRUE((*session)->subscribe<innovation_t>("INNOVATION", 4096, [&](const innovation_t& message) {
        answers.sequence.push_back(message.header.sequence);
        answers.nis.push_back(message.nis);
    }));
    EXPECT_TRUE((*session)->start());
    EXPECT_TRUE((*session)->run_until_finished());
    return answers;
}

TEST(Session, EveryFrameIsWorkedThroughBeforeTheNext) {
    const Answers answers = run_echo("[ramp]\nframes = 500\n[echo]\nrounds = 7\n");
    ASSERT_EQ(answers.sequence.size(), 500u);
    for (std::size_t i = 0; i < 500; ++i) ASSERT_EQ(answers.sequence[i], static_cast<std::int64_t>(i) + 1);
}

TEST(Session, ClockOfTheRecordingRulesAndRunsAreIdentical) {
    const Answers first = run_echo("[ramp]\nframes = 50\n");
    const Answers second = run_echo("[ramp]\nframes = 50\nperiod_ms = 0.5\n");
    ASSERT_EQ(first.nis.size(), 50u);
    EXPECT_EQ(first.nis, second.nis);
    // Frame k: x = k mm; clock of the ramp 1 s + 0.1 s k, in the unit of the echo (1e-9 per microsecond).
    EXPECT_DOUBLE_EQ(first.nis[9], 0.010 + 1e-9 * 2'000'000);
}

TEST(Session, LifeHasItsOrder) {
    auto session = Session::open(config_of("", "\"life\"", "case = \"/cases/liver\"\n[life]\ngain = 3\n"));
    ASSERT_TRUE(session) << session.error().text;
    EXPECT_EQ((*session)->extension<test::Life>(), nullptr) << "offered before start";
    ASSERT_TRUE((*session)->start());
    auto* life = (*session)->extension<test::Life>();
    ASSERT_NE(life, nullptr);
    for (int i = 0; i < 3; ++i) (*session)->step();
    EXPECT_THAT(life->calls, ElementsAre("create", "configure", "start", "step"));
    EXPECT_EQ(life->gain, 3.0);
    EXPECT_EQ(life->folder, "/cases/liver");
    EXPECT_FALSE(life->saw_itself);
    (*session)->stop();
    EXPECT_EQ(life->calls.back(), "stop");
    EXPECT_EQ((*session)->extension<test::Life>(), nullptr) << "offered after stop";
    const std::size_t calls = life->calls.size();
    (*session)->stop();
    EXPECT_EQ(life->calls.size(), calls) << "stopped twice";
}

TEST(Session, TextsReachEveryUnitOfALongList) {
    auto session = Session::open(config_of("\"ramp\"", "\"life\", \"echo\", \"thrower\"", "case = \"/cases/liver\"\n"));
    ASSERT_TRUE(session) << session.error().text;
    ASSERT_TRUE((*session)->start());
    EXPECT_EQ((*session)->extension<test::Life>()->folder, "/cases/liver");
}

TEST(Session, UnitThatRefusesItsSettingsIsAnError) {
    EXPECT_EQ(open_error(config_of("", "\"life\"", "[life]\nfail_in = \"configure\"\n")),
              "unit life: gain of the wrong colour");
}

TEST(Session, UnitThatCannotStartStopsTheOthers) {
    for (const auto& [where, text] :
         {std::pair{"start", "unit life: no such device"}, {"throw", "unit life: thrown on purpose"}}) {
        auto session = Session::open(
            config_of("\"ramp\"", "\"echo\", \"life\"", std::string("[life]\nfail_in = \"") + where + "\"\n"));
        ASSERT_TRUE(session) << session.error().text;
        const Status started = (*session)->start();
        ASSERT_FALSE(started);
        EXPECT_EQ(started.error().kind, ErrorKind::kHostFault);
        EXPECT_EQ(started.error().text, text);
        EXPECT_EQ((*session)->plugins()[0]->state(), UnitState::kStopped);
        EXPECT_EQ((*session)->plugins()[1]->state(), UnitState::kFailed);
        EXPECT_FALSE((*session)->step().worked);
    }
}

TEST(Session, UnitThatThrowsInStepIsNotSteppedAgain) {
    auto session = Session::open(config_of("\"ramp\"", "\"thrower\", \"echo\""));
    ASSERT_TRUE(session) << session.error().text;
    ASSERT_TRUE((*session)->start());
    const Status status = (*session)->run_until_finished();
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().text, "unit thrower failed while running");
    EXPECT_TRUE((*session)->step().worked) << "the other units live on";
}

TEST(Session, UnknownUnitSectionOrKindIsAnError) {
    EXPECT_THAT(open_error(config_of("", "\"lief\"")), HasSubstr("unit lief: no teres_lief.so in "));
    EXPECT_EQ(open_error(config_of("", "\"echo\"", "[lief]\ngain = 1\n")),
              "test.toml:5: [lief] is not a known section (did you mean life?)");
    EXPECT_EQ(open_error(config_of("\"echo\"", "")), "unit echo is a plugin: name it in service.plugins");
    EXPECT_EQ(open_error(config_of("", "\"ramp\"")), "unit ramp is a driver: name it in service.drivers");
    EXPECT_EQ(open_error(config_of("", "\"echo\"", "[life]\ngian = 1\n")),
              "test.toml:6: life.gian is not a known setting (did you mean gain?)")
        << "sections out of use are checked too";
    EXPECT_EQ(open_error(config_of("", "\"life\"", "[life]\ngain = 11\n")),
              "test.toml:6: life.gain = 11 is above the bound 10");
    EXPECT_THAT(open_error(config_of("", "\"newer_major\"")), HasSubstr("plugin API 2.0"));
    EXPECT_THAT(open_error(config_of("", "\"no_unit\"")), HasSubstr("has no unit no_unit"));
    EXPECT_THAT(open_error(config_of("", "\"" + test::plugin_file("no_unit").string() + "\"")),
                HasSubstr("unit plain: its factory gave no unit"));
}

TEST(Session, BadBusUrlIsAnError) {
    EXPECT_THAT(open_error(config_of("", "", "bus_url = \"tcp://x\"\n")), HasSubstr("tcp://x"));
}

TEST(Session, NothingFinishesWithoutDrivers) {
    auto session = Session::open(config_of("", "\"echo\""));
    ASSERT_TRUE(session);
    ASSERT_TRUE((*session)->start());
    EXPECT_THAT((*session)->run_until_finished().error().text, HasSubstr("service.drivers is empty"));
}

TEST(Session, OwnerCanStopTheRun) {
    auto session = Session::open(config_of("\"ramp\"", "", "[ramp]\nendless = true\n"));
    ASSERT_TRUE(session);
    ASSERT_TRUE((*session)->start());
    int turns = 0;
    EXPECT_TRUE((*session)->run_until_finished([&] { return ++turns < 20; }));
    EXPECT_EQ(turns, 20);
}

const channel_health_t* channel(const health_t& health, const std::string& name) {
    for (const auto& entry : health.channels)
        if (entry.channel == name) return &entry;
    return nullptr;
}

TEST(Session, HealthTellsTrafficDropsStepsAndMemory) {
    auto session = Session::open(
        config_of("\"ramp\"", "\"echo\", \"life\"", "[ramp]\nframes = 40\nskip_every = 10\n[echo]\ndegraded = true\n"));
    ASSERT_TRUE(session) << session.error().text;
    std::vector<health_t> heard;
    ASSERT_TRUE(
        (*session)->subscribe<health_t>("HEALTH", 1 << 20, [&](const health_t& message) { heard.push_back(message); }));
    ASSERT_TRUE((*session)->start());
    ASSERT_TRUE((*session)->publish_health());
    EXPECT_EQ((*session)->health().units[0].state, "absent");
    ASSERT_TRUE((*session)->run_until_finished());
    ASSERT_TRUE((*session)->publish_health());
    (*session)->step();
    ASSERT_EQ(heard.size(), 2u);
    const health_t& health = heard[1];
    EXPECT_EQ(health.header.sequence, 2);
    // Of 40 frames every tenth is skipped: 36 messages, gaps at 10, 20, 30; the run ends with frame 41 > 40.
    const auto* markers = channel(health, "MARKERS");
    ASSERT_NE(markers, nullptr);
    EXPECT_EQ(markers->received, 37);
    EXPECT_EQ(markers->dropped, 4);
    EXPECT_GE(markers->age_s, 0.0);
    EXPECT_GT(markers->rate_hz, 0.0);
    const auto* innovation = channel(health, "INNOVATION");
    ASSERT_NE(innovation, nullptr) << "what nobody here reads is counted as it leaves";
    EXPECT_EQ(innovation->received, 37);
    ASSERT_EQ(health.num_units, 3);
    EXPECT_EQ(health.units[0].unit, "ramp");
    EXPECT_EQ(health.units[0].state, "finished");
    EXPECT_EQ(health.units[1].unit, "echo");
    EXPECT_EQ(health.units[1].state, "degraded");
    EXPECT_EQ(health.units[1].steps, 3 * 37);
    EXPECT_EQ(health.units[1].degraded_steps, 3 * 37);
    EXPECT_GT(health.units[1].step_ms_max, 0.0);
    EXPECT_GE(health.units[1].step_ms_max, health.units[1].step_ms_mean);
    EXPECT_EQ(health.units[2].state, "running");
    EXPECT_GT(health.resident_memory_mb, 1.0);
    EXPECT_GE(health.peak_memory_mb, 0.9 * health.resident_memory_mb);
    EXPECT_GT(health.loop_ms_max, 0.0);
    EXPECT_GE(health.loop_iterations, 38);
}

TEST(Session, RecordingOfAReplayIsTheSameEveryTime) {
    test::ScratchFolder scratch;
    std::string logs[2];
    for (int run = 0; run < 2; ++run) {
        const auto file = scratch.path() / ("run" + std::to_string(run) + ".lcm");
        auto session = Session::open(
            config_of("\"ramp\"", "\"echo\"", "record_to = \"" + file.string() + "\"\n[ramp]\nframes = 20\n"));
        ASSERT_TRUE(session) << session.error().text;
        ASSERT_TRUE((*session)->start());
        ASSERT_TRUE((*session)->run_until_finished());
        (*session)->stop();
        std::ifstream stream(file, std::ios::binary);
        logs[run] = {std::istreambuf_iterator<char>(stream), {}};
    }
    EXPECT_GT(logs[0].size(), 40u * 60u);
    EXPECT_EQ(logs[0], logs[1]);
}

TEST(Session, RecordingMayNotReplaceALogUnlessAsked) {
    test::ScratchFolder scratch;
    const auto file = scratch.path() / "old.lcm";
    std::ofstream(file) << "precious";
    EXPECT_THAT(open_error(config_of("", "", "record_to = \"" + file.string() + "\"\n")), HasSubstr("old.lcm"));
    EXPECT_EQ(open_error(config_of("", "", "record_to = \"" + file.string() + "\"\nrecord_overwrite = true\n")), "");
}

}  // namespace
}  // namespace teres
