// teres diagnose CASE...: where simulation and recording part, which missing effect is to blame, how far the gap
// closes. --live: the same of what the service's alarm points at.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/bus.h"
#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "core/clock.h"
#include "core/dated_path.h"
#include "core/service.h"
#include "teres/gap_t.hpp"
#include "tools/commands.h"
#include "tools/diagnosis_run.h"
#include "tools/gap_report.h"
#include "tools/position_table.h"
#include "tools/progress.h"
#include "tools/stream_window.h"

namespace teres::tools {
namespace {

using Json = nlohmann::ordered_json;

struct DiagnoseOptions {
    std::vector<std::string> cases, excluded;
    std::string json_file, report_folder, predict_file, cache_folder = default_cache_folder();
    bool plan = false;
    int max_effects = 3;
    bool live = false;
    std::string url = kDefaultBusUrl, folder = "gaps";
    double before_s = 15.0, after_s = 5.0;
    SettingsOptions settings;
};

constexpr std::size_t kLiveFrames = 60;  // of a window

std::string joined(const Json& names, const char* separator = " + ") {
    std::string text;
    for (const auto& name : names) text += (text.empty() ? "" : separator) + name.get<std::string>();
    return text;
}

void print_gap(const Json& j) {
    const Json &gap = j["gap"], &s = j["shrinkage"];
    std::printf("%s: gap %.2f mm, floor of noise and model error %.2f mm\n", j["case"].get<std::string>().c_str(),
                gap["rms_mm"].get<double>(), gap["noise_floor_mm"].get<double>());
    std::printf("  %-44s %11s   %s\n", "answer", "probability", "inseparable here");
    struct Row {
        std::string name;
        double probability;
        std::string rivals;
    };
    std::vector<Row> rows{{"none (nothing beyond the floor)", j["none_probability"].get<double>(), ""},
                          {"unknown (no effect of the catalogue)", j["unknown_probability"].get<double>(), ""}};
    for (const auto& cause : j["causes"])
        if (cause["probability"].get<double>() >= 0.005)
            rows.push_back(
                {joined(cause["effects"]), cause["probability"].get<double>(), joined(cause["confusable_with"], ", ")});
    std::stable_sort(rows.begin(), rows.end(),
                     [](const Row& a, const Row& b) { return a.probability > b.probability; });
    for (const Row& row : rows)
        std::printf("  %-44s %9.1f %%   %s\n", row.name.c_str(), 100.0 * row.probability, row.rivals.c_str());
    if (!s["effects"].empty()) {
        for (const auto& p : j["causes"][0]["parameters"])
            std::printf("    %-24s %12.5g +- %-10.3g %s\n", p["name"].get<std::string>().c_str(),
                        p["mean"].is_null() ? 0.0 : p["mean"].get<double>(),
                        p["stdev"].is_null() ? 0.0 : p["stdev"].get<double>(), p["unit"].get<std::string>().c_str());
        std::printf("  held out (%s): %.2f mm -> %.2f mm, %.0f %% of the gap gone\n",
                    s["heldout"].get<std::string>().c_str(), s["before_rms_mm"].get<double>(),
                    s["after_rms_mm"].get<double>(),
                    100.0 * (s["fraction"].is_null() ? 0.0 : s["fraction"].get<double>()));
    }
    for (const auto& t : j["transfers"])
        std::printf("  fitted on %s, predicting %s: %.2f mm -> %.2f mm\n", t["fitted"].get<std::string>().c_str(),
                    t["predicted"].get<std::string>().c_str(), t["before_rms_mm"].get<double>(),
                    t["after_rms_mm"].get<double>());
    if (j["ladder"].size() > 1)
        for (const auto& step : j["ladder"])
            std::printf("    %-44s %7.2f mm fitted, %7.2f mm held out\n",
                        step["effects"].empty() ? "nominal" : joined(step["effects"]).c_str(),
                        step["fitted_rms_mm"].get<double>(), step["heldout_rms_mm"].get<double>());
    std::printf("  next: %s\n", j["next_experiment"].get<std::string>().c_str());
}

void print_plan(const Json& j) {
    const Json& id = j["identifiability"];
    std::printf("%s: what this recording could reveal\n", j["case"].get<std::string>().c_str());
    std::printf("  %-20s %12s  %-8s %s\n", "effect", "chi^2", "visible", "stands in for it (overlap)");
    for (std::size_t c = 0; c < id["effects"].size(); ++c) {
        std::vector<std::pair<double, std::string>> rivals;
        for (std::size_t d = 0; d < id["effects"].size(); ++d)
            if (d != c) rivals.emplace_back(id["overlap"][c][d].get<double>(), id["effects"][d].get<std::string>());
        std::sort(rivals.rbegin(), rivals.rend());
        std::string text;
        for (std::size_t k = 0; k < rivals.size() && k < 3 && rivals[k].first > 0.3; ++k) {
            char item[80];
            std::snprintf(item, sizeof item, "%s%s %.2f", k > 0 ? ", " : "", rivals[k].second.c_str(), rivals[k].first);
            text += item;
        }
        std::printf("  %-20s %12.3g  %-8s %s\n", id["effects"][c].get<std::string>().c_str(),
                    id["visibility_chi2"][c].is_null() ? 0.0 : id["visibility_chi2"][c].get<double>(),
                    id["visible"][c].get<bool>() ? "yes" : "no", text.c_str());
    }
    for (const auto& pair : id["inseparable"])
        std::printf("  %s looks like %s: %s\n", pair["effect"].get<std::string>().c_str(),
                    pair["stand_in"].get<std::string>().c_str(), pair["separated_by"].get<std::string>().c_str());
    for (const auto& s : j["suggestions"])
        std::printf("  to see %s: %s\n", s["effect"].get<std::string>().c_str(),
                    s["made_visible_by"].get<std::string>().c_str());
    for (const auto& a : id["not_in_question"])
        std::printf("  not in question: %s (%s)\n", a["effect"].get<std::string>().c_str(),
                    a["why"].get<std::string>().c_str());
}

// Where the prior has the ligament, for the picture.
std::string with_attachment(const std::string& report_json, const Case& c) {
    if (c.ligament_prior.empty()) return report_json;
    Json j = Json::parse(report_json);
    j["attachment"] = Json::array();
    for (const auto& entry : c.ligament_prior)
        if (entry.probability >= 0.5) j["attachment"].push_back(c.mesh.nodes[static_cast<std::size_t>(entry.node_id)]);
    return j.dump();
}

Result<int> diagnose(const DiagnoseOptions& options) {
    TERES_TRY_ASSIGN(const Config config, read_offline_settings(options.settings));
    DiagnosisRunOptions work;
    work.excluded = options.excluded;
    work.cache_folder = options.cache_folder;
    work.plan_only = options.plan;
    work.max_effects = options.max_effects;
    for (const std::string& assignment : options.settings.overrides) work.settings_text += assignment + "\n";
    if (!options.settings.config_file.empty()) {
        TERES_TRY_ASSIGN(const std::string text, read_text_file(options.settings.config_file));
        work.settings_text += text;
    }
    std::unique_ptr<Progress> bar;
    std::string stage;
    work.progress = [&](const std::string& name, double part) {
        if (stage != name) {
            if (bar != nullptr) bar->finish();
            bar = std::make_unique<Progress>(name, 100);
            stage = name;
        }
        bar->update(static_cast<std::size_t>(100.0 * std::clamp(part, 0.0, 1.0)));
    };
    auto result = diagnose_cases(options.cases, config, work);
    bar.reset();
    if (!result) return tl::unexpected(result.error());
    const Json json = Json::parse(result->gap_json);
    if (options.plan) {
        print_plan(json);
    } else {
        print_gap(json);
        if (!options.report_folder.empty()) {
            TERES_TRY_ASSIGN(const Case c, read_case(options.cases.front()));
            TERES_TRY(
                write_gap_report(with_attachment(result->report_json, c), c.mesh, c.sensor, options.report_folder));
            std::printf("  report: %s/index.html\n", options.report_folder.c_str());
        }
        if (!options.predict_file.empty()) {
            PositionTable table;
            const std::size_t stride = 3 * result->point_id.size();
            for (std::size_t f = 0; f < result->time_s.size(); ++f)
                table.add(result->time_s[f], result->point_id, std::span(result->points_m).subspan(f * stride, stride));
            TERES_TRY(table.write(options.predict_file));
        }
    }
    if (!options.json_file.empty()) TERES_TRY(write_text_file(options.json_file, result->gap_json));
    return kDone;
}

// gaps/20261121-201500, -1, -2, ... if it is there already.
std::filesystem::path folder_of_now(const std::filesystem::path& parent) {
    const std::filesystem::path first = parent / dated("%Y%m%d-%H%M%S");
    std::filesystem::path folder = first;
    for (int k = 1; std::filesystem::exists(folder); ++k) folder = first.string() + "-" + std::to_string(k);
    return folder;
}

// The window of one alarm: kept as a case folder, the answer beside it.
Status diagnose_window(const DiagnoseOptions& options, const StreamWindow& window, std::int64_t onset_us) {
    const auto before_us = static_cast<std::int64_t>(1e6 * options.before_s);
    TERES_TRY_ASSIGN(Case c, window.cut(onset_us - before_us, kLiveFrames));
    const std::filesystem::path folder = folder_of_now(options.folder);
    c.name = folder.filename().string();
    TERES_TRY(write_case(c, folder));
    std::fprintf(stderr, "%s: %d frames, %.1f s; diagnosing\n", folder.c_str(), c.num_frames,
                 c.dt_s * (c.num_frames - 1));
    DiagnoseOptions one = options;
    one.cases = {folder.string()};
    one.json_file = folder / "gap.json";
    one.report_folder = folder / "report";
    TERES_TRY(diagnose(one));
    return {};
}

// Waits for alarms of the service. What comes while a window is worked on is let pass: the bus never waits for anybody.
int diagnose_live(const DiagnoseOptions& options) {
    auto config = read_offline_settings(options.settings);
    if (!config) return report(config.error());
    const bool told = !options.settings.config_file.empty();  // the service's own settings
    const std::string url = told ? config->service().bus_url : options.url,
                      folder = options.cases.empty() ? config->service().case_folder.string() : options.cases.front();
    if (folder.empty())
        return report({ErrorKind::kInvalidInput,
                       "diagnose --live: no CASE is given and service.case of --config does not name one"});
    if (url.starts_with("memq://"))
        return report({ErrorKind::kInvalidInput,
                       "diagnose --live: memq:// cannot be heard from outside its process; "
                       "set service.bus_url to udpm://..."});
    auto base = read_case(folder);
    if (!base) return report(base.error());
    auto bus = Bus::open(url);
    if (!bus) return report(bus.error());
    StreamWindow window(std::move(*base), options.before_s + 2.0 * options.after_s);
    std::optional<std::int64_t> onset_us;  // of the alarm that is waited out
    bool alarmed = false;
    const auto hear = [&](const char* channel, auto message, auto take) {
        return bus->subscribe(
            channel, kMaxMessageBytes,
            [message, take](std::string_view, std::span<const std::uint8_t> data, std::int64_t) mutable {
                if (message.decode(data.data(), 0, static_cast<int>(data.size())) >= 0) take(message);
            });
    };
    for (const Status& heard : {hear("MARKERS", markers_t{}, [&](const markers_t& m) { window.add(m); }),
                                hear("TOOL_LOADS", tool_loads_t{}, [&](const tool_loads_t& m) { window.add(m); }),
                                hear("GAP", gap_t{}, [&](const gap_t& m) {
                                    if (m.alarm != 0 && !alarmed) onset_us = m.onset_stamp_us;
                                    alarmed = m.alarm != 0;
                                })})
        if (!heard) return report(heard.error());
    const StopSignals signals;
    const auto after_us = static_cast<std::int64_t>(1e6 * options.after_s);
    std::fprintf(stderr, "waiting for alarms of GAP on %s; Ctrl-C ends\n", url.c_str());
    while (!signals.stop()) {
        if (bus->dispatch(100) < 0) return report({ErrorKind::kHostFault, "bus " + url + " failed"});
        if (!onset_us || window.newest_us() < *onset_us + after_us) continue;
        if (const Status done = diagnose_window(options, window, *std::exchange(onset_us, std::nullopt)); !done)
            report(done.error());
        const std::int64_t until_us = monotonic_us() + 100'000;  // what has piled up is old
        while (monotonic_us() < until_us && bus->dispatch(0) > 0) {
        }
        onset_us.reset();
    }
    return kDone;
}

}  // namespace

void add_diagnose_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<DiagnoseOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "diagnose",
        "The gap between simulation and recording: where, which missing effect, how far it shrinks",
        "  teres diagnose CASE --json gap.json --report report\n"
        "  teres diagnose --plan CASE                         # before recording: what could this reveal, what not?\n"
        "  teres diagnose CASE1 CASE2                         # one body: named on CASE1, predicted on CASE2\n"
        "  teres diagnose CASE --exclude viscoelasticity      # with an effect withheld from the catalogue\n"
        "  teres diagnose --live CASE -o /var/lib/teres/gaps   # waits for alarms of the service, diagnoses each "
        "window\n"
        "`none` (nothing beyond the floor) and `unknown` (no effect of the catalogue) are answers too.\n"
        "Exit code 1: a diagnosis cannot be made (the reason is printed); 2: a case, an effect or a setting is wrong.",
        [options] {
            if (options->live) return diagnose_live(*options);
            if (options->cases.empty())
                return report({ErrorKind::kInvalidInput, "diagnose: no CASE is given; see teres diagnose --help"});
            const Result<int> code = diagnose(*options);
            return code ? *code : report(code.error());
        });
    verb->add_option("case", options->cases, "Case folders (teres-case-1) of one body")->type_name("CASE");
    verb->add_option("--json", options->json_file, "Write the diagnosis as JSON (teres-gap-1)")->type_name("FILE");
    verb->add_option("--report", options->report_folder, "Write a report: index.html, its data as CSV, pictures")
        ->type_name("DIR");
    verb->add_option("--predict", options->predict_file,
                     "Write t_s,point_id,x_m,y_m,z_m of the points of validation_rest.csv with the named effects added")
        ->type_name("CSV");
    verb->add_option("--exclude", options->excluded, "Leave an effect out of the catalogue; may be repeated")
        ->type_name("EFFECT")
        ->allow_extra_args(false);
    verb->add_flag("--plan", options->plan, "Only what geometry, markers and loads could reveal; observations unused");
    verb->add_option("--max-effects", options->max_effects, "Most effects at once")
        ->check(CLI::Range(1, 5))
        ->capture_default_str();
    verb->add_option("--cache", options->cache_folder, "Folder for what is computed once per body; \"\": none")
        ->type_name("DIR")
        ->capture_default_str();
    verb->add_flag(
        "--live", options->live,
        "Wait for alarms of GAP on the bus; keep each window as a case folder, its answer and report beside it");
    verb->add_option("-o,--output", options->folder, "--live: folder of the windows and their reports")
        ->type_name("DIR")
        ->capture_default_str();
    verb->add_option("--url", options->url, "--live: LCM URL of the bus, where no --config names it")
        ->envname("LCM_DEFAULT_URL")
        ->capture_default_str();
    verb->add_option("--before", options->before_s, "--live: [s] of the window before the onset")
        ->check(CLI::Range(1.0, 600.0))
        ->capture_default_str();
    verb->add_option("--after", options->after_s, "--live: [s] after it")
        ->check(CLI::Range(0.5, 600.0))
        ->capture_default_str();
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
