// Runs a built program as a user would and keeps what it printed.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/test_data.h"

extern char** environ;

namespace teres::test {

struct Run {
    int exit_code = -1;  ///< 128 + signal if the program was killed by one (a crash), -1 if it could not be started
    std::string output, error;
};

/// <build>/bin/<name>; $TERES_BUILD_DIR is set by teres_add_test.
inline std::filesystem::path program_path(const std::string& name) {
    const char* build = std::getenv("TERES_BUILD_DIR");
    return std::filesystem::path(build != nullptr ? build : ".") / "bin" / name;
}

/// Waits for the end of the program; ctest's time limit guards against one that never ends.
inline Run run_program(const std::filesystem::path& program, const std::vector<std::string>& arguments) {
    const ScratchFolder scratch;
    const std::string out = (scratch.path() / "out").string(), err = (scratch.path() / "err").string();
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&files, 1, out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    posix_spawn_file_actions_addopen(&files, 2, err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    std::vector<std::string> words{program.string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);

    Run run;
    pid_t child = 0;
    const int failed = posix_spawn(&child, program.c_str(), &files, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    if (failed != 0) {
        ADD_FAILURE() << program << " cannot be started (is it built?)";
        return run;
    }
    int status = 0;
    waitpid(child, &status, 0);
    run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    const auto text = [](const std::string& file) {
        std::stringstream all;
        all << std::ifstream(file).rdbuf();
        return all.str();
    };
    run.output = text(out);
    run.error = text(err);
    return run;
}

inline Run run_teres(const std::vector<std::string>& arguments) {
    return run_program(program_path("teres"), arguments);
}

}  // namespace teres::test
