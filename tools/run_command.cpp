// teres run: the service. Hosts the drivers and plugins named in the settings file until it is told to stop.
#include <memory>

#include "core/service.h"
#include "tools/commands.h"

namespace teres::tools {
namespace {

int run(const SettingsOptions& options) {
    const auto config = read_settings(options);
    if (!config) return report(config.error());
    const StopSignals signals;
    const Status status = run_service(*config, signals.stop());
    return status ? kDone : report(status.error());
}

}  // namespace

void add_run_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<SettingsOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "run", "Run the service (what systemd starts)",
                 "  teres run\n"
                 "  teres run --config /etc/teres/teres.toml\n"
                 "  teres run --config config/teres.toml --set replay.speed=0 --set service.record_to=run.lcm",
                 [options] { return run(*options); });
    add_settings_options(*verb, *options);
}

}  // namespace teres::tools
