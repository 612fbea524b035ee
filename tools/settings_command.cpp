// teres settings: every setting of the runtime and of the installed units as a settings file, from the tables
// that the units themselves carry.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <sstream>

#include "core/plugin_host.h"
#include "tools/commands.h"

namespace teres::tools {
namespace {

std::string number(double value) {
    std::ostringstream text;
    text.precision(15);
    text << value;
    return text.str();
}

std::string range(const teres_setting& setting) {
    switch (setting.type) {
        case TERES_SETTING_NUMBER:
        case TERES_SETTING_INTEGER:
            return number(setting.min) + " to " + number(setting.max);
        case TERES_SETTING_BOOLEAN:
            return "true or false";
        case TERES_SETTING_PATH:
            return "path";
        default:
            return setting.choices != nullptr && *setting.choices != '\0' ? setting.choices : "text";
    }
}

std::string value(const teres_setting& setting) {
    if (setting.type == TERES_SETTING_BOOLEAN) return setting.default_number != 0.0 ? "true" : "false";
    if (setting.type == TERES_SETTING_NUMBER || setting.type == TERES_SETTING_INTEGER)
        return number(setting.default_number);
    return std::string("\"") + (setting.default_text != nullptr ? setting.default_text : "") + "\"";
}

// Range and meaning below the assignment, wrapped.
void print_setting(const std::string& assignment, const std::string& meaning) {
    std::printf("# %s\n", assignment.c_str());
    std::istringstream words(meaning);
    std::string line;
    for (std::string word; words >> word;) {
        if (!line.empty() && line.size() + 1 + word.size() > 104) {
            std::printf("#     %s\n", line.c_str());
            line.clear();
        }
        line += (line.empty() ? "" : " ") + word;
    }
    std::printf("#     %s\n", line.c_str());
}

void print_table(std::span<const teres_setting> table) {
    for (const teres_setting& setting : table)
        print_setting(std::string(setting.key) + " = " + value(setting),
                      range(setting) + "; " + (setting.help != nullptr ? setting.help : ""));
}

struct Options {
    SettingsOptions settings;
    std::vector<std::string> units;
};

int run(const Options& options) {
    // Without a settings file the plugins beside the program are shown.
    Config config;
    if (!options.settings.config_file.empty() || !options.settings.overrides.empty()) {
        auto read = read_settings(options.settings);
        if (!read) return report(read.error());
        config = std::move(*read);
    }
    const auto folders = plugin_folders(config.service().plugin_folder);
    std::vector<std::string> units = options.units;
    if (units.empty()) {
        units = available_plugins(folders);
        units.insert(units.begin(), "service");
    }
    std::printf(
        "# Every setting with its default; below it its range and meaning. Take the leading # away to change "
        "one.\n");
    for (const std::string& unit : units) {
        if (unit == "service") {
            std::printf("\n# The runtime: which units run, over which bus, what is recorded\n[service]\n");
            print_setting("drivers = [\"replay\"]", "list; devices and recordings: ids, or paths of .so files");
            print_setting("plugins = [\"simulation\", \"estimator\"]",
                          "list; ids, or paths of .so files; started and stepped in this order");
            print_table(service_table());
            continue;
        }
        const auto file = find_plugin(unit, folders);
        if (!file) return report(file.error());
        const auto plugin = load_plugin(*file);
        if (!plugin) return report(plugin.error());
        for (const teres_factory* factory : plugin->factories) {
            std::printf("\n# Unit %s: %s\n[%s]\n", factory->id, factory->summary != nullptr ? factory->summary : "",
                        factory->id);
            print_table(std::span(factory->settings, factory->num_settings));
        }
    }
    return kDone;
}

}  // namespace

void add_settings_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<Options>();
    CLI::App* verb = add_verb(app, exit_code, "settings", "Print every setting with its default, range and meaning",
                              "  teres settings > teres.toml\n"
                              "  teres settings simulation estimator",
                              [options] { return run(*options); });
    verb->add_option("units", options->units, "Units to show (default: service and all that are installed)")
        ->type_name("UNIT");
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
