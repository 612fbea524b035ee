#include "tools/commands.h"

#include <algorithm>
#include <cstdio>

#include "core/log.h"

namespace teres::tools {

namespace fs = std::filesystem;

namespace {

// A log of a whole session holds MARKERS; made anew from its frames by observation, they must not come twice.
Status skip_recorded_markers(Config& config) {
    const auto uses = [](const std::vector<std::string>& units, const char* id) {
        return std::ranges::find(units, id) != units.end();
    };
    if (!uses(config.service().plugins, "observation") || !uses(config.service().drivers, "replay")) return {};
    if (config.given("replay", "skip_channels")) return {};
    return config.set(
        "replay.skip_channels=BOUNDARY_ESTIMATE|LIVER_STATE|INNOVATION|GAP|HEALTH|TRACKING|REGISTRATION|SURFACE_POINTS|"
        "MARKERS");
}

}  // namespace

int report(const Error& error) {
    std::fprintf(stderr, "teres: %s\n", error.text.c_str());
    return static_cast<int>(error.kind);
}

CLI::App* add_verb(CLI::App& app, int& exit_code, const std::string& name, const std::string& summary,
                   const std::string& examples, std::function<int()> run) {
    CLI::App* verb = app.add_subcommand(name, summary);
    verb->footer("Examples:\n" + examples);
    verb->callback([&exit_code, run = std::move(run)] { exit_code = run(); });
    return verb;
}

void add_settings_options(CLI::App& verb, SettingsOptions& options) {
    verb.add_option("-c,--config", options.config_file, "Settings file (TOML)")->type_name("FILE");
    verb.add_option("--set", options.overrides, "Override one setting; may be repeated")
        ->type_name("SECTION.KEY=VALUE")
        ->allow_extra_args(false);
}

std::vector<fs::path> default_settings_files() {
    std::vector<fs::path> files = {"/etc/teres/teres.toml"};
    std::error_code failure;
    const fs::path program = fs::read_symlink("/proc/self/exe", failure);
    if (failure) return files;
    files.push_back(program.parent_path().parent_path() / "share/teres/config/teres.toml");
    // <tree>/build/<preset>/bin/teres
    files.push_back(program.parent_path().parent_path().parent_path().parent_path() / "config/teres.toml");
    return files;
}

Result<Config> read_settings(const SettingsOptions& options) {
    fs::path file = options.config_file;
    std::string searched;
    for (const fs::path& candidate : default_settings_files()) {
        std::error_code failure;
        if (file.empty() && fs::is_regular_file(candidate, failure)) file = candidate;
        searched += (searched.empty() ? "" : ", ") + candidate.string();
    }
    if (file.empty()) return invalid_input("no settings file: --config not given and none of " + searched + " exists");
    TERES_TRY_ASSIGN(Config config, Config::read(file));
    for (const std::string& assignment : options.overrides) TERES_TRY(config.set(assignment));
    TERES_TRY(skip_recorded_markers(config));
    if (options.config_file.empty()) log(Level::kInfo, "config", "settings from " + file.string());
    return config;
}

Result<Config> read_offline_settings(const SettingsOptions& options) {
    if (!options.config_file.empty()) return read_settings(options);
    Config config;
    for (const std::string& assignment : options.overrides) TERES_TRY(config.set(assignment));
    return config;
}

}  // namespace teres::tools
