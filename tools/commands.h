// The verbs of the `teres` program. Each lives in <verb>_command.cpp, adds its subcommand (with --help and
// examples in the footer) and, when it is the one given, runs and leaves its exit code. main.cpp lists them.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/result.h"

namespace teres::tools {

/// Exit codes of every verb; 1, 2 and 3 are the values of ErrorKind.
enum ExitCode : int { kDone = 0, kNotUsableExit = 1, kUsageExit = 2, kHostFaultExit = 3 };

/// Prints `teres: <text>` to standard error and returns the exit code of the error's kind.
int report(const Error& error);

/// The subcommand `name`; `run` is called after parsing, what it returns is the exit code of the program.
CLI::App* add_verb(CLI::App& app, int& exit_code, const std::string& name, const std::string& summary,
                   const std::string& examples, std::function<int()> run);

/// The options --config FILE and --set section.key=value (repeatable), shared by every verb that hosts units.
struct SettingsOptions {
    std::string config_file;             ///< empty: not given
    std::vector<std::string> overrides;  ///< "section.key=value"
};
void add_settings_options(CLI::App& verb, SettingsOptions& options);
/// The settings file (the given one, else the first of default_settings_files() that exists) with the
/// overrides on top.
Result<Config> read_settings(const SettingsOptions& options);
/// For offline verbs: without --config the built-in defaults, so that a result depends on no file of the host.
Result<Config> read_offline_settings(const SettingsOptions& options);
/// /etc/teres/teres.toml, then the one installed beside the program, then config/teres.toml of the tree it
/// was built in.
std::vector<std::filesystem::path> default_settings_files();

/// Where record and spy listen unless told otherwise.
inline constexpr const char* kDefaultBusUrl = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=16777216";
/// Messages that record and spy let wait in liblcm.
inline constexpr int kDeepQueue = 1000;

void add_atlas_command(CLI::App& app, int& exit_code);
void add_bench_command(CLI::App& app, int& exit_code);
void add_bridge_command(CLI::App& app, int& exit_code);
void add_blindtest_command(CLI::App& app, int& exit_code);
void add_cut_command(CLI::App& app, int& exit_code);
void add_calibrate_springs_command(CLI::App& app, int& exit_code);
void add_doctor_command(CLI::App& app, int& exit_code);
void add_mesh_command(CLI::App& app, int& exit_code);
void add_effects_command(CLI::App& app, int& exit_code);
void add_record_command(CLI::App& app, int& exit_code);
void add_replay_command(CLI::App& app, int& exit_code);
void add_diagnose_command(CLI::App& app, int& exit_code);
void add_estimate_command(CLI::App& app, int& exit_code);
void add_run_command(CLI::App& app, int& exit_code);
void add_score_command(CLI::App& app, int& exit_code);
void add_simulate_command(CLI::App& app, int& exit_code);
void add_settings_command(CLI::App& app, int& exit_code);
void add_spy_command(CLI::App& app, int& exit_code);

}  // namespace teres::tools
