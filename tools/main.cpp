// The `teres` program: one verb per file; exit codes 0 done, 1 result not usable, 2 wrong usage or input, 3
// host fault.
#include <cstdio>
#include <exception>

#include "tools/commands.h"

namespace teres::tools {

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

}  // namespace teres::tools

int main(int argc, char** argv) {
    using namespace teres::tools;
    try {
        int exit_code = kDone;
        CLI::App app{"Teres: what holds the liver, from camera frames to boundary conditions", "teres"};
        app.set_version_flag("--version", "teres " TERES_VERSION);
        app.require_subcommand(1);
        app.footer(
            "`teres VERB --help` explains a verb and gives examples.\n"
            "Exit codes: 0 done, 1 ran but the result is not usable, 2 wrong usage or input, 3 host or "
            "device fault.");
        add_run_command(app, exit_code);
        add_score_command(app, exit_code);
        try {
            app.parse(argc, argv);
        } catch (const CLI::ParseError& error) {
            return app.exit(error) == 0 ? kDone : kUsageExit;
        }
        return exit_code;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "teres: %s\n", error.what());
        return kHostFaultExit;
    }
}
