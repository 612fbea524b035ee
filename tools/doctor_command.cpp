// teres doctor: checks of host, settings, bus and devices, each with its remedy.
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "tools/commands.h"
#include "tools/host_checks.h"

namespace teres::tools {
namespace {

struct Options {
    SettingsOptions settings;
    std::string json_file;
};

int write_json(const std::string& file, const std::vector<Check>& checks, int failures, int warnings) {
    nlohmann::ordered_json json{{"format", "teres-doctor-1"}, {"failures", failures}, {"warnings", warnings}};
    for (const Check& check : checks)
        json["checks"].push_back({{"name", check.name},
                                  {"state", state_word(check.state)},
                                  {"found", check.found},
                                  {"remedy", check.remedy}});
    std::ofstream stream(file);
    stream << json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
    stream.close();
    if (!stream) return report({ErrorKind::kHostFault, file + ": cannot be written"});
    return kDone;
}

int run(const Options& options) {
    std::vector<Check> checks;
    auto config = read_settings(options.settings);
    if (config) {
        checks.push_back({"config", CheckState::kOk, "read", ""});
        for (Check& check : check_settings(*config)) checks.push_back(std::move(check));
    } else {
        checks.push_back(
            {"config", CheckState::kFail, config.error().text, "`teres settings` prints a file to start from"});
        config = Config{};
    }
    for (auto* look : {&check_network, &check_devices})
        for (Check& check : (*look)(*config, HostView{})) checks.push_back(std::move(check));
    for (Check& check : check_appliance(HostView{})) checks.push_back(std::move(check));
    for (Check& check : check_process(*config)) checks.push_back(std::move(check));

    int failures = 0, warnings = 0;
    for (const Check& check : checks) {
        failures += check.state == CheckState::kFail ? 1 : 0;
        warnings += check.state == CheckState::kWarn ? 1 : 0;
        std::printf("%-5s %-28s %s%s%s\n", state_word(check.state), check.name.c_str(), check.found.c_str(),
                    check.remedy.empty() ? "" : "\n      -> ", check.remedy.c_str());
    }
    std::printf("%zu checks: %d failed, %d warnings\n", checks.size(), failures, warnings);
    if (!options.json_file.empty())
        if (const int code = write_json(options.json_file, checks, failures, warnings); code != kDone) return code;
    return failures > 0 ? kHostFaultExit : kDone;
}

}  // namespace

void add_doctor_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<Options>();
    CLI::App* verb = add_verb(app, exit_code, "doctor", "Check host, settings, bus and devices, with remedies",
                              "  teres doctor\n"
                              "  teres doctor --config /etc/teres/teres.toml --json doctor.json\n"
                              "  teres doctor --set 'service.bus_url=udpm://239.255.76.67:7667?ttl=0'",
                              [options] { return run(*options); });
    add_settings_options(*verb, options->settings);
    verb->add_option("--json", options->json_file, "Write the checks to this file as well")->type_name("FILE");
}

}  // namespace teres::tools
