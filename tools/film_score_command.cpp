// teres film-score FILM LOG: markers that the observation plugin found in a phantom's film, against the film's truth.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/csv_table.h"
#include "core/case/geometry.h"
#include "core/log_reader.h"
#include "teres/markers_t.hpp"
#include "tools/film_commands.h"

namespace teres::tools {
namespace {

struct FilmScoreOptions {
    std::filesystem::path film, log, json, case_folder, cases_out;
    double identity_m = 0.010;
};

using FrameKey = std::int64_t;        // capture stamp [us]
constexpr FrameKey kRounding_us = 2;  // of times in text files
using Truth = std::map<FrameKey, std::map<std::int32_t, Point>>;
using Visible = std::map<FrameKey, std::map<std::int32_t, bool>>;

FrameKey key(double t_s) {
    return std::llround(1e6 * t_s);
}

double quantile(std::vector<double> values, double share) {
    if (values.empty()) return std::nan("");
    std::sort(values.begin(), values.end());
    return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

struct MarkerScore {
    std::vector<double> error_m;
    std::map<std::int32_t, std::vector<double>> error_of;
    std::int64_t frames = 0, visible = 0, reported = 0, reported_visible = 0, hidden_reported = 0, identity_errors = 0;
    double at(double share) const { return quantile(error_m, share); }
    void add(const markers_t& m, const std::map<std::int32_t, Point>& truth, const std::map<std::int32_t, bool>& seen,
             double identity_m) {
        ++frames;
        for (const auto& [id, sees] : seen) visible += sees ? 1 : 0;
        for (std::size_t i = 0; i < m.x_m.size(); ++i) {
            const auto own = truth.find(m.marker_id[i]);
            if (std::isnan(m.x_m[i]) || own == truth.end()) continue;
            const Point x{m.x_m[i], m.y_m[i], m.z_m[i]};
            const double error = distance(x, own->second);
            error_m.push_back(error);
            error_of[m.marker_id[i]].push_back(error);
            ++reported;
            const bool sees = seen.at(own->first);
            reported_visible += sees ? 1 : 0;
            hidden_reported += sees ? 0 : 1;
            const bool other_nearer =
                std::any_of(truth.begin(), truth.end(), [&](const auto& t) { return distance(x, t.second) < error; });
            identity_errors += other_nearer || error > identity_m ? 1 : 0;
        }
    }
};

// The case at its own frame times as the camera saw it (found) and as it was (true): estimating both tells what the
// camera costs. Inner points: the film's truth at these times.
Status write_cases(const FilmScoreOptions& options, const std::vector<PositionSample>& found,
                   const std::vector<PositionSample>& truth) {
    TERES_TRY_ASSIGN(Case c, read_case(options.case_folder));
    std::set<FrameKey> frames;
    for (const PositionSample& row : c.observations) frames.insert(key(row.t_s));
    const auto near_frame = [&](const PositionSample& row) {
        const auto frame = frames.lower_bound(key(row.t_s) - kRounding_us);
        return frame != frames.end() && *frame <= key(row.t_s) + kRounding_us;
    };
    TERES_TRY_ASSIGN(auto inner, read_positions(options.film / "validation.csv", "point_id"));
    std::erase_if(inner, [&](const PositionSample& row) { return !near_frame(row); });
    for (const auto& [name, rows] : {std::pair{"found", &found}, {"true", &truth}}) {
        c.observations.clear();
        std::copy_if(rows->begin(), rows->end(), std::back_inserter(c.observations), near_frame);
        if (c.observations.empty())
            return invalid_input(options.film.string() + " holds no frame at the times of " +
                                 options.case_folder.string());
        TERES_TRY(write_case(c, options.cases_out / name));
        TERES_TRY(write_positions(options.cases_out / name / "validation.csv", "point_id", inner));
    }
    return {};
}

Result<int> film_score(const FilmScoreOptions& options) {
    Truth truth;
    TERES_TRY_ASSIGN(const auto rows, read_positions(options.film / "markers.csv", "marker_id"));
    for (const PositionSample& row : rows) truth[key(row.t_s)][row.id] = row.position_m;
    Visible visible;
    const std::vector<CsvColumn> columns{{"t_s"}, {"marker_id", CsvKind::kId}, {"visible", CsvKind::kId}};
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(options.film / "visible.csv", columns));
    for (std::size_t row = 0; row < table.num_rows(); ++row)
        visible[key(table.number(row, 0))][table.id(row, 1)] = table.id(row, 2) != 0;

    TERES_TRY_ASSIGN(LogReader reader, LogReader::open(options.log));
    MarkerScore score;
    std::vector<PositionSample> found;
    std::int64_t unknown = 0;
    LogEvent event;
    markers_t m;
    while (reader.next(event)) {
        if (event.channel != "MARKERS" || m.decode(event.data.data(), 0, static_cast<int>(event.data.size())) < 0)
            continue;
        for (std::size_t i = 0; i < m.x_m.size(); ++i)
            found.push_back({1e-6 * static_cast<double>(m.header.capture_stamp_us),
                             m.marker_id[i],
                             {m.x_m[i], m.y_m[i], m.z_m[i]}});
        auto frame = truth.lower_bound(m.header.capture_stamp_us - kRounding_us);
        if (frame == truth.end() || frame->first > m.header.capture_stamp_us + kRounding_us ||
            !visible.contains(frame->first))
            ++unknown;
        else
            score.add(m, frame->second, visible[frame->first], options.identity_m);
    }
    if (score.frames == 0)
        return invalid_input(options.log.string() + ": no MARKERS at the times of " +
                             (options.film / "markers.csv").string());
    const auto share = [](std::int64_t part, std::int64_t of) {
        return of > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(of) : 0.0;
    };
    const std::int64_t all = score.frames * static_cast<std::int64_t>(truth.begin()->second.size());
    std::printf("%lld frames, %.1f %% of the markers hidden\n", static_cast<long long>(score.frames),
                share(all - score.visible, all));
    std::printf("  3-D error            median %.3f mm, 95th percentile %.3f mm, largest %.3f mm\n",
                1e3 * score.at(0.5), 1e3 * score.at(0.95), 1e3 * score.at(1.0));
    std::printf("  visible and reported %.1f %%\n", share(score.reported_visible, score.visible));
    std::printf("  hidden but reported  %lld\n", static_cast<long long>(score.hidden_reported));
    std::printf("  identity errors      %lld of %lld\n", static_cast<long long>(score.identity_errors),
                static_cast<long long>(score.reported));
    if (unknown > 0) std::printf("  frames without truth %lld\n", static_cast<long long>(unknown));
    if (!options.json.empty()) {
        nlohmann::json markers = nlohmann::json::array();
        for (const auto& [id, error_m] : score.error_of)
            markers.push_back({{"marker_id", id},
                               {"reported", error_m.size()},
                               {"error_median_m", quantile(error_m, 0.5)},
                               {"error_p95_m", quantile(error_m, 0.95)}});
        const nlohmann::json out{{"frames", score.frames},
                                 {"hidden_share", 0.01 * share(all - score.visible, all)},
                                 {"error_median_m", score.at(0.5)},
                                 {"error_p95_m", score.at(0.95)},
                                 {"error_max_m", score.at(1.0)},
                                 {"visible_reported_share", 0.01 * share(score.reported_visible, score.visible)},
                                 {"hidden_reported", score.hidden_reported},
                                 {"identity_errors", score.identity_errors},
                                 {"reported", score.reported},
                                 {"markers", markers}};
        std::FILE* file = std::fopen(options.json.c_str(), "w");
        if (file == nullptr) return host_fault("cannot write " + options.json.string());
        std::fprintf(file, "%s\n", out.dump(1).c_str());
        if (std::fclose(file) != 0) return host_fault("cannot write " + options.json.string());
    }
    if (!options.cases_out.empty()) TERES_TRY(write_cases(options, found, rows));
    return kDone;
}

}  // namespace

void add_film_score_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<FilmScoreOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "film-score", "Markers found in a phantom's film against the film's truth",
        "  teres phantom config/cases/demo -o film --seconds 60 --occlusion 0.3\n"
        "  teres replay film/recording.lcm --case config/cases/demo --speed 0 --set service.plugins=observation \\\n"
        "      --set service.record_to=tracked.lcm\n"
        "  teres film-score film tracked.lcm\n"
        "  teres film-score film tracked.lcm --case config/cases/demo --write-cases cases      # cases/found, "
        "cases/true\n"
        "Identity error: a reported marker that is nearer to another one's true place, or further than 10 mm from its "
        "own.",
        [options] {
            const Result<int> code = film_score(*options);
            return code ? *code : report(code.error());
        });
    verb->add_option("film", options->film, "Folder that `teres phantom` wrote")->required()->type_name("DIR");
    verb->add_option("log", options->log, "LCM log with MARKERS")->required()->type_name("LOG");
    verb->add_option("--json", options->json, "Write the figures")->type_name("FILE");
    CLI::Option* of = verb->add_option("--case", options->case_folder, "Case that was filmed")->type_name("FOLDER");
    verb->add_option("--write-cases", options->cases_out,
                     "Write the case with the markers found and with the true ones")
        ->type_name("DIR")
        ->needs(of);
}

}  // namespace teres::tools
