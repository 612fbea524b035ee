// teres run: the service. Hosts the drivers and plugins named in the settings file until it is told to stop.
#include <memory>

#include "tools/commands.h"

namespace teres::tools {

void add_run_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<SettingsOptions>();
    CLI::App* verb = add_verb(app, exit_code, "run", "Run the service (what systemd starts)",
                              "  teres run --config /etc/teres/teres.toml\n"
                              "  teres run --config config/teres.toml --set replay.speed=0",
                              [options] {
                                  return report({ErrorKind::kHostFault, "run: not in this build"});
                              });
    add_settings_options(*verb, *options);
}

}  // namespace teres::tools
