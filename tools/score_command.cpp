// teres score CASE PREDICTION.csv: predicted positions against the case's validation.csv.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/case/case_reader.h"
#include "core/case/text_writer.h"
#include "tools/commands.h"
#include "tools/plot.h"
#include "tools/score.h"

namespace teres::tools {
namespace {

struct ScoreOptions {
    std::string case_folder, prediction_file, json_file, plot_file;
    std::vector<std::string> compare;
};

void print(const Score& score, const ScoreOptions& options) {
    std::printf("%s against %s: %zu positions, %zu frames, %zu points\n", options.prediction_file.c_str(),
                options.case_folder.c_str(), score.num_positions, score.frames.size(), score.num_points);
    if (score.num_positions > 0) {
        std::printf("  mean %9.3f mm\n  rms  %9.3f mm\n  median %7.3f mm\n  95 %% %9.3f mm\n", score.mean_mm,
                    score.rms_mm, score.median_mm, score.p95_mm);
        std::printf("  max  %9.3f mm  (point %d at t = %g s)\n", score.max_mm, score.max_point_id, score.max_t_s);
        const FrameError& worst = score.frames[score.worst_frame];
        std::printf("  worst frame: t = %g s, mean %.3f mm\n", worst.t_s, worst.mean_mm);
        std::printf("  mean over time (t [s]: mean [mm]):");
        // about twelve frames tell the course; all of them are in --json and --plot
        const std::size_t stride = (score.frames.size() + 11) / 12;
        for (std::size_t i = 0; i < score.frames.size(); i += stride)
            std::printf("%s%g: %.2f", i == 0 ? " " : ", ", score.frames[i].t_s, score.frames[i].mean_mm);
        std::printf("\n");
    }
    if (score.num_ignored > 0)
        std::printf("  %zu predicted rows at times that validation.csv does not have were left out\n",
                    score.num_ignored);
}

nlohmann::ordered_json to_json(const Score& score, const ScoreOptions& options) {
    nlohmann::ordered_json json;
    json["format"] = "teres-score-1";
    json["case"] = options.case_folder;
    json["prediction"] = options.prediction_file;
    json["positions"] = score.num_positions;
    json["points"] = score.num_points;
    json["missing"] = score.num_missing;
    json["missing_first"] = score.missing;
    json["ignored_rows"] = score.num_ignored;
    // a value that does not exist (nothing predicted) is written as null
    json["error_mm"] = {{"mean", score.mean_mm},
                        {"rms", score.rms_mm},
                        {"median", score.median_mm},
                        {"p95", score.p95_mm},
                        {"max", score.max_mm}};
    json["max_at"] = {{"t_s", score.max_t_s}, {"point_id", score.max_point_id}};
    const FrameError& worst = score.frames[score.worst_frame];
    json["worst_frame"] = {{"t_s", worst.t_s}, {"mean_mm", worst.mean_mm}};
    json["frames"] = nlohmann::ordered_json::array();
    for (const FrameError& frame : score.frames)
        json["frames"].push_back(
            {{"t_s", frame.t_s}, {"points", frame.num_points}, {"mean_mm", frame.mean_mm}, {"max_mm", frame.max_mm}});
    return json;
}

Curve error_curve(const std::string& label, const Score& score, double FrameError::*value) {
    Curve curve{label, {}, {}};
    for (const FrameError& frame : score.frames) {
        curve.x.push_back(frame.t_s);
        curve.y.push_back(frame.num_points > 0 ? frame.*value : std::numeric_limits<double>::quiet_NaN());
    }
    return curve;
}

Result<Score> score_file(const std::vector<PositionSample>& truth, const std::string& file) {
    TERES_TRY_ASSIGN(const auto prediction, read_positions(file, "point_id", true));
    auto result = score_prediction(truth, prediction);
    if (!result) return invalid_input(file + ": " + result.error().text);
    return *result;
}

Status save_score_plot(const Score& score, const std::vector<PositionSample>& truth, const ScoreOptions& options) {
    Plot plot;
    const auto folder = std::filesystem::weakly_canonical(options.case_folder);  // may end with a slash
    plot.title = "Error of the predicted points, case " +
                 (folder.has_filename() ? folder : folder.parent_path()).filename().string();
    plot.x_label = "time [s]";
    char text[64];
    std::snprintf(text, sizeof text, "mean of all, %.2f mm", score.mean_mm);
    Panel panel{.y_label = "error [mm]", .from_zero = true};
    const auto name = [](const std::string& file) { return std::filesystem::path(file).stem().string() + ", mean"; };
    panel.curves.push_back(error_curve(options.compare.empty() ? "mean over the points" : name(options.prediction_file),
                                       score, &FrameError::mean_mm));
    if (options.compare.empty()) panel.curves.push_back(error_curve("largest", score, &FrameError::max_mm));
    for (const auto& file : options.compare) {
        TERES_TRY_ASSIGN(const Score other, score_file(truth, file));
        panel.curves.push_back(error_curve(name(file), other, &FrameError::mean_mm));
    }
    if (score.num_positions > 0 && options.compare.empty()) panel.references.push_back({text, score.mean_mm});
    plot.panels.push_back(panel);
    return save_plot(plot, options.plot_file);
}

Result<int> score(const ScoreOptions& options) {
    const std::filesystem::path truth_file = std::filesystem::path(options.case_folder) / "validation.csv";
    TERES_TRY_ASSIGN(const auto truth, read_positions(truth_file, "point_id"));
    const auto result = score_file(truth, options.prediction_file);
    if (!result) return tl::unexpected(result.error());
    print(*result, options);
    if (!options.json_file.empty())
        TERES_TRY(write_text_file(options.json_file, to_json(*result, options).dump(1) + "\n"));
    if (!options.plot_file.empty()) TERES_TRY(save_score_plot(*result, truth, options));
    if (result->num_missing == 0) return kDone;
    std::string text = options.prediction_file + ": " + std::to_string(result->num_missing) + " of " +
                       std::to_string(result->num_missing + result->num_positions) + " positions are not predicted: ";
    for (std::size_t i = 0; i < result->missing.size(); ++i) text += (i == 0 ? "" : ", ") + result->missing[i];
    if (result->missing.size() < result->num_missing) text += ", ...";
    return not_usable(text);
}

}  // namespace

void add_score_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<ScoreOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "score", "error of predicted positions against a case's validation.csv",
                 "  teres score cases/control predict.csv\n"
                 "  teres score cases/control predict.csv --json score.json --plot score.png\n"
                 "  teres score cases/control estimated.csv --compare fixed.csv floor.csv --plot errors.png\n"
                 "Exit code 1: positions are missing; 2: a file is malformed.",
                 [options] {
                     const Result<int> code = score(*options);
                     return code ? *code : report(code.error());
                 });
    verb->add_option("case", options->case_folder, "Case folder with validation.csv")->required()->type_name("CASE");
    verb->add_option("prediction", options->prediction_file, "t_s,point_id,x_m,y_m,z_m")->required()->type_name("CSV");
    verb->add_option("--json", options->json_file, "Write the figures as JSON")->type_name("FILE");
    verb->add_option("--plot", options->plot_file, "Draw the error over time (PNG)")->type_name("FILE");
    verb->add_option("--compare", options->compare, "Draw the mean error of these predictions beside it")
        ->type_name("CSV");
}

}  // namespace teres::tools
