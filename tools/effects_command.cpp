// teres effects [CASE]: the catalogue of unmodelled effects: parameters, units, priors, sources.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/extensions/trajectory_model.h"
#include "core/session.h"
#include "tools/commands.h"
#include "tools/effect_options.h"

namespace teres::tools {
namespace {

struct EffectsOptions {
    std::string case_folder, json_file;
    SettingsOptions settings;
};

const char* kHead =
    "effect             kind       family                     parameter       unit    prior (68 %)           "
    " bounds\n";

// The middle 68 % of the prior.
std::string prior_range(const EffectParameter& p) {
    const bool log = p.transform == EffectTransform::kLog;
    const double low = p.prior_mean - p.prior_stdev, high = p.prior_mean + p.prior_stdev;
    char text[64];
    std::snprintf(text, sizeof text, "%.3g .. %.3g", std::max(p.lower, log ? std::exp(low) : low),
                  std::min(p.upper, log ? std::exp(high) : high));
    return text;
}

void print(const EffectCatalogue& catalogue) {
    for (std::size_t e = 0; e < catalogue.num_effects(); ++e) {
        const EffectInfo info = catalogue.effect(e);
        for (std::int32_t i = 0; i < info.num_parameters; ++i) {
            const EffectParameter p = catalogue.effect_parameter(e, static_cast<std::size_t>(i));
            std::printf("%-18s %-10s %-26s %c %-13s %-7s %-23s %.4g .. %.4g\n", i == 0 ? info.id : "",
                        i == 0 ? info.kind : "", i == 0 ? info.family : "",
                        p.role == EffectRole::kAmplitude ? '*' : ' ', p.name, p.unit, prior_range(p).c_str(), p.lower,
                        p.upper);
        }
        std::printf("    %s%s. Source: %s\n", info.summary, info.event ? " (event)" : "", info.source);
        if (info.not_applicable != nullptr)
            std::printf("    not in this case: %s\n", info.not_applicable);
        else
            std::printf("    %d places, times and frequencies are searched\n", info.num_candidates);
    }
}

nlohmann::json as_json(const EffectCatalogue& catalogue) {
    nlohmann::json list = nlohmann::json::array();
    for (std::size_t e = 0; e < catalogue.num_effects(); ++e) {
        const EffectInfo info = catalogue.effect(e);
        nlohmann::json entry{{"id", info.id},
                             {"kind", info.kind},
                             {"family", info.family},
                             {"summary", info.summary},
                             {"source", info.source},
                             {"event", info.event},
                             {"candidates", info.num_candidates}};
        entry["not_applicable"] = info.not_applicable != nullptr ? nlohmann::json(info.not_applicable) : nullptr;
        for (std::int32_t i = 0; i < info.num_parameters; ++i) {
            const EffectParameter p = catalogue.effect_parameter(e, static_cast<std::size_t>(i));
            const bool amplitude = p.role == EffectRole::kAmplitude, log = p.transform == EffectTransform::kLog;
            entry["parameters"].push_back({{"name", p.name},
                                           {"unit", p.unit},
                                           {"role", amplitude ? "amplitude" : "shape"},
                                           {"transform", log ? "log" : "identity"},
                                           {"null", amplitude ? nlohmann::json(p.null_value) : nullptr},
                                           {"prior_mean", p.prior_mean},
                                           {"prior_stdev", p.prior_stdev},
                                           {"lower", p.lower},
                                           {"upper", p.upper}});
        }
        list.push_back(entry);
    }
    return list;
}

Result<int> show(const EffectsOptions& options) {
    TERES_TRY_ASSIGN(Config config, read_offline_settings(options.settings));
    std::string folder = options.case_folder;
    for (const auto& file : default_settings_files()) {
        const auto demo = file.parent_path() / "cases" / "demo";
        if (folder.empty() && std::filesystem::is_directory(demo)) folder = demo.string();
    }
    if (folder.empty()) return invalid_input("no CASE given and no demo case beside the program");
    TERES_TRY(config.set("service.case=" + folder));
    TERES_TRY(config.set("service.drivers="));
    TERES_TRY(config.set("service.plugins=simulation,sensor_model"));
    TERES_TRY(config.set("simulation.trajectories=true"));
    TERES_TRY_ASSIGN(const std::unique_ptr<Session> session, Session::open(config));
    TERES_TRY(session->start());
    const auto* mechanics = session->extension<TrajectoryModel>();
    const auto* sensor = session->extension<ObservationModel>();
    if (mechanics == nullptr || sensor == nullptr)
        return host_fault(std::string("the plugins offer no ") + TrajectoryModel::kId + " or no " + ObservationModel::kId);
    if (!options.json_file.empty()) {
        nlohmann::json all{{"format", "teres-effects-1"}, {"case", folder}, {"effects", as_json(*mechanics)}};
        for (auto& entry : as_json(*sensor)) all["effects"].push_back(entry);
        std::ofstream out(options.json_file);
        out << all.dump(1) << "\n";
        if (!out.flush()) return host_fault(options.json_file + ": cannot be written");
    }
    std::printf("%zu effects that the nominal model leaves out; ranges for %s\n* vanishes at its null value\n\n%s",
                mechanics->num_effects() + sensor->num_effects(), folder.c_str(), kHead);
    print(*mechanics);
    print(*sensor);
    return kDone;
}

}  // namespace

void add_effects_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<EffectsOptions>();
    CLI::App* verb = add_verb(app, exit_code, "effects", "Catalogue of what a nominal model may leave out",
                              "  teres effects\n"
                              "  teres effects CASE --json effects.json\n"
                              "Ranges, places and times are those of the case (without one: of the demo case).",
                              [options] {
                                  const Result<int> code = show(*options);
                                  return code ? *code : report(code.error());
                              });
    verb->add_option("case", options->case_folder, "Case folder")->type_name("CASE");
    verb->add_option("--json", options->json_file, "Write the catalogue as JSON")->type_name("FILE");
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
