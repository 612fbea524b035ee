// The program as its users meet it: exit codes, help, and the verbs run, settings and doctor.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <thread>

#include "core/log_reader.h"
#include "tests/core/plugins/test_plugins.h"
#include "tests/support/program.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using test::run_teres;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

std::filesystem::path source_file(const std::string& path) {
    return std::filesystem::path(std::getenv("TERES_SOURCE_DIR")) / path;
}

std::string text_of(const std::filesystem::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
}

// A settings file that plays the test plugins.
class TeresProgram : public testing::Test {
  protected:
    std::string write(const std::string& rest) {
        const auto file = scratch_.path() / "test.toml";
        std::ofstream(file) << "[service]\nplugin_folder = \"" << test::plugin_folder().string()
                            << "\"\ndrivers = [\"ramp\"]\nplugins = [\"echo\"]\n"
                            << rest;
        return file.string();
    }
    test::ScratchFolder scratch_;
};

TEST_F(TeresProgram, UsageErrorsEndWithTwo) {
    EXPECT_EQ(run_teres({}).exit_code, 2);
    EXPECT_EQ(run_teres({"dance"}).exit_code, 2);
    EXPECT_EQ(run_teres({"run", "--speed"}).exit_code, 2);
    EXPECT_EQ(run_teres({"run", "--set", "nonsense"}).exit_code, 2);
    EXPECT_EQ(run_teres({"run", "--config", "/no/such.toml"}).exit_code, 2);
}

TEST_F(TeresProgram, EveryVerbHasHelpWithExamples) {
    const auto all = run_teres({"--help"});
    EXPECT_EQ(all.exit_code, 0);
    const std::string list = all.output.substr(all.output.find("Subcommands:"));
    const std::regex verb("\n  ([a-z-]+) ");
    int verbs = 0;
    for (std::sregex_iterator at(list.begin(), list.end(), verb), end; at != end; ++at, ++verbs) {
        const auto help = run_teres({(*at)[1].str(), "--help"});
        EXPECT_EQ(help.exit_code, 0) << (*at)[1];
        EXPECT_THAT(help.output, HasSubstr("Examples:\n  teres ")) << (*at)[1];
    }
    EXPECT_GE(verbs, 3);
    EXPECT_THAT(run_teres({"--version"}).output, StartsWith("teres "));
}

TEST_F(TeresProgram, RunEndsWithTheRecording) {
    const auto log = (scratch_.path() / "run.lcm").string();
    const auto run =
        run_teres({"run", "--config", write("[ramp]\nframes = 12\n"), "--set", "service.record_to=" + log});
    EXPECT_EQ(run.exit_code, 0) << run.error;
    auto reader = LogReader::open(log);
    ASSERT_TRUE(reader) << reader.error().text;
    std::map<std::string, int> messages;
    for (LogEvent event; reader->next(event);) ++messages[std::string(event.channel)];
    EXPECT_EQ(messages["MARKERS"], 12);
    EXPECT_EQ(messages["INNOVATION"], 12);
    EXPECT_GE(messages["HEALTH"], 2);
}

TEST_F(TeresProgram, RunTellsWhatIsWrongWithTheSettings) {
    const auto run = run_teres({"run", "--config", write("[ramp]\nfrmes = 12\n")});
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_THAT(run.error, HasSubstr("test.toml:6: ramp.frmes is not a known setting (did you mean frames?)"));
}

TEST_F(TeresProgram, RunEndsOnSigtermWithZero) {
    const std::string file = write("[ramp]\nendless = true\nperiod_ms = 5\n");
    const std::string program = test::program_path("teres").string();
    const pid_t child = fork();
    if (child == 0) {
        execl(program.c_str(), program.c_str(), "run", "--config", file.c_str(), nullptr);
        _exit(127);
    }
    std::this_thread::sleep_for(std::chrono::seconds(3));
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, WNOHANG), 0) << "ended before it was told to";
    kill(child, SIGTERM);
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
    EXPECT_EQ(WEXITSTATUS(status), 0);
}

// Every setting of every unit that is installed stands in the shipped file: those commented out with their
// default.
TEST_F(TeresProgram, ShippedSettingsFileIsComplete) {
    const auto run = run_teres({"settings"});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    std::istringstream known(run.output);
    const std::string shipped = text_of(source_file("config/teres.toml"));
    const auto section_of = [&](const std::string& name) {
        const auto begin = shipped.find(std::string("\n[").append(name).append("]\n"));
        if (begin == std::string::npos) return std::string();
        return shipped.substr(begin, shipped.find("\n[", begin + 1) - begin);
    };
    std::string section, text;
    for (std::string line; std::getline(known, line);) {
        std::smatch found;
        if (std::regex_match(line, found, std::regex("\\[(\\w+)\\]"))) {
            section = found[1];
            text = section_of(section);
            EXPECT_NE(text, "") << "config/teres.toml has no section [" << section << "]";
        } else if (std::regex_match(line, found, std::regex("# (\\w+) = .*"))) {
            const bool set =
                std::regex_search(text, std::regex(std::string("\n").append(found[1].str()).append(" = ")));
            EXPECT_TRUE(set || text.find(std::string("\n").append(line).append("\n")) != std::string::npos)
                << "config/teres.toml, [" << section << "] lacks the line: " << line;
        }
    }
}

TEST_F(TeresProgram, ShippedSettingsPassTheDoctor) {
    const auto json_file = scratch_.path() / "doctor.json";
    const auto run =
        run_teres({"doctor", "--config", source_file("config/teres.toml").string(), "--json", json_file.string()});
    EXPECT_EQ(run.exit_code, 0) << run.output;
    const auto json = nlohmann::json::parse(text_of(json_file));
    EXPECT_EQ(json["format"], "teres-doctor-1");
    EXPECT_EQ(json["failures"], 0);
    std::map<std::string, std::string> states;
    for (const auto& check : json["checks"]) {
        states[check["name"]] = check["state"];
        EXPECT_EQ(check["remedy"] == "", check["state"] == "ok") << check;
    }
    for (const char* name :
         {"config", "plugin simulation", "plugin estimator", "plugin replay", "settings", "case", "bus memq://"})
        EXPECT_EQ(states[name], "ok") << name;
}

TEST_F(TeresProgram, DoctorFailsWithRemedies) {
    const auto broken =
        run_teres({"doctor", "--config", write("[ramp]\nfrmes = 1\n"), "--set", "service.case=/no/such/case"});
    EXPECT_EQ(broken.exit_code, 3);
    EXPECT_THAT(broken.output, AllOf(HasSubstr("ramp.frmes is not a known setting"), HasSubstr("fail  case")));
    // The folder holds plugins broken in many ways; unused ones are warnings.
    EXPECT_THAT(broken.output, AllOf(HasSubstr("warn  plugin newer_major"), HasSubstr("warn  plugin crashes")));
    const auto missing = run_teres({"doctor", "--config", "/no/such.toml"});
    EXPECT_EQ(missing.exit_code, 3);
    EXPECT_THAT(missing.output, HasSubstr("fail  config"));
}

}  // namespace
}  // namespace teres
