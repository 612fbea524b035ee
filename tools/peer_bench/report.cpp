#include "tools/peer_bench/report.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "tools/peer_bench/own_run.h"
#include "tools/peer_bench/peer_run.h"
#include "tools/peer_bench/scene_reader.h"

namespace teres::peer {

namespace {

double seconds_since(std::chrono::steady_clock::time_point begin) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

Progress progress_bar(const std::string& what) {
    if (!isatty(STDERR_FILENO)) return {};
    return [what](int done, int total) {
        if (done % 50 == 0 || done == total)
            std::fprintf(stderr, "\r%-40s %6d / %d%s", what.c_str(), done, total, done == total ? "\n" : "");
    };
}

std::string format(const char* pattern, ...) __attribute__((format(printf, 1, 2)));
std::string format(const char* pattern, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, pattern);
    std::vsnprintf(text, sizeof text, pattern, arguments);
    va_end(arguments);
    return text;
}

void fill_final(const Scene& scene, const ParameterMap& map, const FilterRun& run, FolderReport& report) {
    const int last_step = scene.expected_step.back();
    const auto last = run.mean.rows() - 1;
    for (std::size_t i = 0; i < scene.filter.names.size(); ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        const Transform transform = scene.filter.transform[i];
        FinalValue value{scene.filter.names[i], run.mean(last, at), run.stdev(last, at), scene.truth(i, last_step)};
        if (transform == Transform::kLog || transform == Transform::kScaledSigmoid) {
            value.stdev = map.physical_stdev(at, value.mean, value.stdev);
            value.mean = map.to_physical(at, value.mean);
        }
        report.final.push_back(value);
    }
}

// Seconds from `event_step` until the column of `mean` is first below `threshold`.
std::optional<double> delay_below(const Eigen::MatrixXd& mean, const std::vector<int>& step, Eigen::Index column,
                                  int event_step, double threshold, double dt_s) {
    for (std::size_t row = 0; row < step.size(); ++row)
        if (step[row] >= event_step && mean(static_cast<Eigen::Index>(row), column) < threshold)
            return (step[row] - event_step + 1) * dt_s;
    return std::nullopt;
}

constexpr double kConsistentNis = 10.0;  // median per degree of freedom; 1 is expected

OwnReport own_report(const Scene& scene, const OwnRun& run) {
    OwnReport out;
    out.seconds = run.seconds;
    for (const auto point : run.refused) out.refused_points.push_back(static_cast<int>(point));
    const auto last = run.mean.rows() - 1;
    const std::size_t known = scene.filter.names.size();
    for (std::size_t i = 0; i < run.names.size(); ++i) {
        const auto column = static_cast<Eigen::Index>(i);
        const double truth = i < known ? scene.truth(i, run.step.back()) : scene.generator.velocity_damping_1_s;
        out.final.push_back({run.names[i], run.mean(last, column), run.stdev(last, column), truth});
        if (i >= known) continue;
        out.sigma_distance.push_back(std::abs(run.mean(last, column) - truth) / run.stdev(last, column));
        const double prior = std::abs(scene.filter.mean(column));
        out.own_error += std::abs(run.mean(last, column) - truth) / prior / static_cast<double>(known);
        out.peer_error += std::abs(scene.expected_state(scene.expected_state.rows() - 1, column) - truth) / prior /
                          static_cast<double>(known);
        for (const Event& event : scene.events) {
            const double before = scene.truth(i, event.from_step - 1), after = scene.truth(i, event.from_step);
            if (!(after < 0.1 * before) || event.from_step > run.step.back()) continue;
            out.releases.push_back(
                {run.names[i], 0.1 * before,
                 delay_below(run.mean, run.step, column, event.from_step, 0.1 * before, scene.generator.dt_s),
                 delay_below(scene.expected_state, scene.expected_step, column, event.from_step, 0.1 * before,
                             scene.generator.dt_s)});
        }
    }
    out.smallest_stdev = run.stdev.leftCols(static_cast<Eigen::Index>(known)).minCoeff();
    return out;
}

}  // namespace

Result<FolderReport> run_folder(const std::filesystem::path& folder, const BenchOptions& options) {
    FolderReport report;
    std::string name = folder.string();
    while (name.size() > 1 && name.back() == '/') name.pop_back();
    report.folder = name;
    if (!std::filesystem::is_directory(folder)) return invalid_input(name + ": not a folder");
    TERES_TRY_ASSIGN(Scene scene, read_scene(name));
    if (options.max_rows > 0 && options.max_rows < scene.compared_rows) {
        scene.compared_rows = options.max_rows;
        scene.expected_step.resize(static_cast<std::size_t>(options.max_rows));
        scene.expected_state = scene.expected_state.topRows(options.max_rows).eval();
    }
    report.warnings = scene.warnings;
    for (const auto& warning : scene.warnings) std::fprintf(stderr, "peer-bench: note: %s\n", warning.c_str());

    TERES_TRY_ASSIGN(const PeerModel generator, PeerModel::make(scene, scene.generator));
    TERES_TRY_ASSIGN(const PeerModel model, PeerModel::make(scene, scene.filter_run));
    const auto begin = std::chrono::steady_clock::now();
    int last_row = 0;
    for (int k = 1; k <= scene.expected_step.back(); ++k) {
        const int row = observation_row(scene, k);
        if (row < 0)
            return invalid_input(name + "/scene.json: filter: observation_row: step " + std::to_string(k) +
                                 " looks at row " + std::to_string(row));
        last_row = std::max(last_row, row);
    }
    TERES_TRY_ASSIGN(const auto z, observations(scene, generator, last_row));
    report.generator_seconds = seconds_since(begin);
    report.rows = scene.compared_rows;
    if (!options.own_only) {
        TERES_TRY_ASSIGN(const FilterRun run, run_peer_filter(scene, model, z, options.threads, progress_bar(name)));
        TERES_TRY_ASSIGN(const ParameterMap map, peer_parameters(scene));
        const Comparison comparison = compare(scene, run);
        report.max_relative_difference = comparison.max_relative_difference;
        report.worst_row = comparison.row;
        report.worst_parameter = scene.filter.names[static_cast<std::size_t>(comparison.parameter)];
        report.reached = comparison.max_relative_difference <= kBound;
        report.seconds = run.seconds;
        fill_final(scene, map, run, report);
        for (int tenth = 0; tenth < 10; ++tenth) {
            const auto from = run.mean.rows() * tenth / 10, to = run.mean.rows() * (tenth + 1) / 10;
            if (from == to) continue;
            const Eigen::ArrayXXd expected = scene.expected_state.middleRows(from, to - from).array();
            report.tenths.push_back(
                ((run.mean.middleRows(from, to - from).array() - expected).abs() / expected.abs().max(1e-300))
                    .maxCoeff());
        }
    } else {
        report.compared = false;
    }
    if (options.own || options.own_only) {
        // Own mode takes the recording's own alignment of tool and loads (its time stamps), not the peer's
        // filter's.
        RunSettings settings = scene.filter_run;
        settings.tool_row_offset = scene.generator.tool_row_offset;
        settings.tool_attached = scene.generator.tool_attached;
        TERES_TRY_ASSIGN(const PeerModel own_model, PeerModel::make(scene, settings));
        const int last_step = scene.expected_step.back();
        TERES_TRY_ASSIGN(OwnRun own, run_own_filter(scene, own_model, z, last_step, 0.0, options.threads,
                                                    progress_bar(name + " (own filter)")));
        if (!(own.closing_nis < kConsistentNis)) {
            // Noise of the rounding alone was too sure of itself: once more with the noise that the folder
            // states.
            TERES_TRY_ASSIGN(own, run_own_filter(scene, own_model, z, last_step, scene.filter.observation_stdev_m,
                                                 options.threads, progress_bar(name + " (own filter, stated noise)")));
            report.warnings.push_back(
                "own filter: rounding alone is too small a noise here, the folder's observation stdev is "
                "used");
        }
        if (own.step.empty()) return not_usable(name + ": the own filter saw no row");
        report.own = own_report(scene, own);
    }
    return report;
}

std::string table_of(const FolderReport& report, bool verbose) {
    std::string out = report.folder + "\n";
    if (report.compared) {
        out += format("  %d rows, largest relative difference %.2e (row %d, %s): %s; %.1f s (generator %.1f s)\n",
                      report.rows, report.max_relative_difference, report.worst_row, report.worst_parameter.c_str(),
                      report.reached ? "within 1e-3" : "ABOVE 1e-3", report.seconds, report.generator_seconds);
        if (verbose) {
            out += "  by tenths of the run:";
            for (const double tenth : report.tenths) out += format(" %.1e", tenth);
            out += "\n";
        }
        out += format("  %-14s %14s %14s %14s\n", "parameter", "mean", "stdev", "truth");
        for (const auto& value : report.final)
            out += format("  %-14s %14.6g %14.6g %14.6g\n", value.name.c_str(), value.mean, value.stdev, value.truth);
    }
    if (report.own) {
        const OwnReport& own = *report.own;
        out += format(
            "  own filter: mean error of the last row %.2e of the prior (peer %.2e); smallest stdev %.2g; "
            "%.1f s\n",
            own.own_error, own.peer_error, own.smallest_stdev, own.seconds);
        for (std::size_t i = 0; i < own.final.size(); ++i) {
            const auto& value = own.final[i];
            out += format("  %-14s %14.6g %14.6g %14.6g", value.name.c_str(), value.mean, value.stdev, value.truth);
            out += i < own.sigma_distance.size() ? format("   %.1f sigma\n", own.sigma_distance[i])
                                                 : "   (estimated besides)\n";
        }
        for (const auto& release : own.releases)
            out += format("  %s released: below %.3g after %.2f s (peer %.2f s)\n", release.name.c_str(),
                          release.threshold, release.own_delay_s.value_or(-1.0), release.peer_delay_s.value_or(-1.0));
        if (!own.refused_points.empty())
            out += format("  %zu observed points refused: they extrapolate far outside the body\n",
                          own.refused_points.size());
    }
    return out;
}

nlohmann::ordered_json json_of(const FolderReport& report) {
    nlohmann::ordered_json out;
    out["folder"] = report.folder;
    if (report.compared) {
        out["max_relative_difference"] = report.max_relative_difference;
        out["rows"] = report.rows;
        auto& final = out["final"] = nlohmann::ordered_json::array();
        for (const auto& value : report.final)
            final.push_back(
                {{"name", value.name}, {"mean", value.mean}, {"stdev", value.stdev}, {"truth", value.truth}});
        out["seconds"] = report.seconds;
    }
    if (report.own) {
        const OwnReport& own = *report.own;
        auto& json = out["own"];
        json["final"] = nlohmann::ordered_json::array();
        for (const auto& value : own.final)
            json["final"].push_back(
                {{"name", value.name}, {"mean", value.mean}, {"stdev", value.stdev}, {"truth", value.truth}});
        json["sigma_distance"] = own.sigma_distance;
        json["mean_error_of_prior"] = {{"own", own.own_error}, {"peer", own.peer_error}};
        json["smallest_stdev"] = own.smallest_stdev;
        json["releases"] = nlohmann::ordered_json::array();
        const auto delay = [](const std::optional<double>& s) {
            return s ? nlohmann::ordered_json(*s) : nlohmann::ordered_json(nullptr);
        };
        for (const auto& r : own.releases)
            json["releases"].push_back({{"name", r.name},
                                        {"below", r.threshold},
                                        {"delay_s", delay(r.own_delay_s)},
                                        {"peer_delay_s", delay(r.peer_delay_s)}});
        json["refused_points"] = own.refused_points;
        json["seconds"] = own.seconds;
    }
    if (!report.warnings.empty()) out["warnings"] = report.warnings;
    return out;
}

}  // namespace teres::peer
