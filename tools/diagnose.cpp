#include "tools/diagnose.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/case/case_reader.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tools/diagnosis_text.h"
#include "tools/gap_report.h"
#include "tools/position_table.h"
#include "tools/progress.h"

namespace teres::tools {
namespace {

using Json = nlohmann::ordered_json;

// Where the prior has the ligament, for the picture.
std::string with_attachment(const std::string& report_json, const Case& c) {
    if (c.ligament_prior.empty()) return report_json;
    Json j = Json::parse(report_json);
    j["attachment"] = Json::array();
    for (const auto& entry : c.ligament_prior)
        if (entry.probability >= 0.5) j["attachment"].push_back(c.mesh.nodes[static_cast<std::size_t>(entry.node_id)]);
    return j.dump();
}

}  // namespace

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
        const auto write_points = [&](const std::vector<double>& points_m, const std::string& file) -> Status {
            if (file.empty()) return {};
            PositionTable table;
            const std::size_t stride = 3 * result->point_id.size();
            for (std::size_t f = 0; f < result->time_s.size(); ++f)
                table.add(result->time_s[f], result->point_id, std::span(points_m).subspan(f * stride, stride));
            return table.write(file);
        };
        TERES_TRY(write_points(result->points_m, options.predict_file));
        TERES_TRY(write_points(result->nominal_points_m, options.predict_nominal_file));
    }
    if (!options.json_file.empty()) TERES_TRY(write_text_file(options.json_file, result->gap_json));
    return kDone;
}

}  // namespace teres::tools
