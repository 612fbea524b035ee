#include "tools/gap_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/case/text_writer.h"
#include "tools/diagnosis_text.h"
#include "tools/liver_picture.h"
#include "tools/plot.h"

namespace teres::tools {
namespace {

using Json = nlohmann::json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double value(const Json& j) {
    return j.is_number() ? j.get<double>() : kNaN;
}

std::string format(const char* text, double number) {
    char out[64];
    std::snprintf(out, sizeof out, text, number);
    return out;
}

// Whether the prediction has the model's own error in it; not where only the beginning of a recording was fitted.
bool model_error_learned(const Json& j) {
    return !j["ladder"].empty() && j["ladder"].back()["model_error"].get<bool>();
}

std::string joined(const Json& names, const char* separator) {
    std::string text;
    for (const auto& name : names) text += (text.empty() ? "" : separator) + name.get<std::string>();
    return text;
}

// rms distance over the seen markers of each frame, before and after.
struct Residuals {
    std::vector<double> t_s, before_mm, after_mm;
};
Residuals residuals(const Json& j) {
    const Json& m = j["markers"];
    const std::size_t markers = m["marker_id"].size(), frames = j["time_s"].size();
    Residuals r;
    for (std::size_t f = 0; f < frames; ++f) {
        double before = 0.0, after = 0.0;
        int seen = 0;
        for (std::size_t row = 3 * f * markers; row < 3 * (f + 1) * markers; ++row) {
            const double y = value(m["observed_m"][row]);
            if (!std::isfinite(y)) continue;
            before += std::pow(y - m["before_m"][row].get<double>(), 2);
            after += std::pow(y - m["after_m"][row].get<double>(), 2);
            ++seen;
        }
        r.t_s.push_back(j["time_s"][f].get<double>());
        r.before_mm.push_back(seen > 0 ? 1e3 * std::sqrt(3.0 * before / seen) : kNaN);
        r.after_mm.push_back(seen > 0 ? 1e3 * std::sqrt(3.0 * after / seen) : kNaN);
    }
    return r;
}

// Greatest distance over time between the body before and after, per node of the surface [m].
std::vector<double> surface_gap(const Json& surface) {
    const double unit = surface["unit_m"].get<double>();
    std::vector<double> gap(surface["node_id"].size(), 0.0);
    for (std::size_t f = 0; f < std::min(surface["before"].size(), surface["after"].size()); ++f)
        for (std::size_t n = 0; n < gap.size(); ++n) {
            double sum = 0.0;
            for (std::size_t a = 0; a < 3; ++a)
                sum += std::pow(
                    surface["after"][f][3 * n + a].get<double>() - surface["before"][f][3 * n + a].get<double>(), 2);
            gap[n] = std::max(gap[n], unit * std::sqrt(sum));
        }
    return gap;
}

Status write_tables(const Json& j, const Residuals& r, const std::vector<double>& gap,
                    const std::filesystem::path& folder) {
    std::string text = "t_s,before_rms_mm,after_rms_mm\n";
    for (std::size_t f = 0; f < r.t_s.size(); ++f)
        text += format("%.6g", r.t_s[f]) + format(",%.5g", r.before_mm[f]) + format(",%.5g\n", r.after_mm[f]);
    TERES_TRY(write_text_file(folder / "residuals.csv", text));

    text = "effects,probability,explained\n";
    for (const auto& cause : j["causes"])
        text += joined(cause["effects"], "+") + format(",%.6g", value(cause["probability"])) +
                format(",%.4g\n", value(cause["explained"]));
    text += "none" + format(",%.6g,\n", value(j["none_probability"]));
    text += "unknown" + format(",%.6g,\n", value(j["unknown_probability"]));
    TERES_TRY(write_text_file(folder / "causes.csv", text));

    text = "effects,parameter,unit,mean,stdev\n";
    for (const auto& cause : j["causes"])
        for (const auto& p : cause["parameters"])
            text += joined(cause["effects"], "+") + "," + p["name"].get<std::string>() + "," +
                    p["unit"].get<std::string>() + format(",%.6g", value(p["mean"])) +
                    format(",%.3g\n", value(p["stdev"]));
    TERES_TRY(write_text_file(folder / "parameters.csv", text));

    const Json& id = j["identifiability"];
    text = "effect,chi2,visible";
    for (const auto& name : id["effects"]) text += "," + name.get<std::string>();
    text += "\n";
    for (std::size_t c = 0; c < id["effects"].size(); ++c) {
        text += id["effects"][c].get<std::string>() + format(",%.4g", value(id["visibility_chi2"][c])) +
                (id["visible"][c].get<bool>() ? ",yes" : ",no");
        for (const auto& overlap : id["overlap"][c]) text += format(",%.3f", value(overlap));
        text += "\n";
    }
    TERES_TRY(write_text_file(folder / "confusability.csv", text));

    text = "effects,fitted_rms_mm,heldout_rms_mm\n";
    for (const auto& step : j["ladder"])
        text += (step["effects"].empty() ? "nominal" : joined(step["effects"], "+")) +
                (step["model_error"].get<bool>() ? "+model error" : "") +
                format(",%.5g", value(step["fitted_rms_mm"])) + format(",%.5g\n", value(step["heldout_rms_mm"]));
    TERES_TRY(write_text_file(folder / "ladder.csv", text));

    text = "marker_id,share\n";
    for (const auto& m : j["where"]["markers"])
        text += std::to_string(m["marker_id"].get<int>()) + format(",%.5g\n", value(m["share"]));
    TERES_TRY(write_text_file(folder / "markers.csv", text));

    text = "effect,x_m,y_m,z_m,explained\n";
    for (const auto& map : j["maps"])
        for (std::size_t k = 0; k < map["explained"].size(); ++k) {
            text += map["effect"].get<std::string>();
            for (std::size_t a = 0; a < 3; ++a) text += format(",%.6g", value(map["center_m"][3 * k + a]));
            text += format(",%.4g\n", value(map["explained"][k]));
        }
    TERES_TRY(write_text_file(folder / "place_maps.csv", text));

    text = "node_id,largest_gap_mm\n";
    for (std::size_t n = 0; n < gap.size(); ++n)
        text += std::to_string(j["surface"]["node_id"][n].get<int>()) + format(",%.4g\n", 1e3 * gap[n]);
    return write_text_file(folder / "surface_gap.csv", text);
}

Status draw(const Json& j, const Residuals& r, const std::vector<double>& gap, const TetMeshData& mesh,
            const SensorData& sensor, const std::filesystem::path& folder) {
    const std::string name = j["case"].get<std::string>();
    Plot plot;
    plot.title = "Markers, observed minus simulated, case " + name;
    plot.x_label = "time [s]";
    const char* after = model_error_learned(j) ? "with named effects and model error" : "with the named effects";
    plot.panels.push_back({.y_label = "rms distance [mm]",
                           .from_zero = true,
                           .curves = {{"nominal", r.t_s, r.before_mm}, {after, r.t_s, r.after_mm}},
                           .references = {{"floor", value(j["gap"]["noise_floor_mm"])}}});
    TERES_TRY(save_plot(plot, folder / "residuals.png"));

    BarPlot bars;
    bars.title = "Probability of each answer, case " + name;
    bars.y_label = "probability";
    BarSet set{"", {}, {}};
    for (std::size_t k = 0; k < j["causes"].size() && k < 5; ++k) {
        bars.groups.push_back(joined(j["causes"][k]["effects"], "+"));
        set.values.push_back(value(j["causes"][k]["probability"]));
    }
    for (const char* answer : {"none", "unknown"}) {
        bars.groups.emplace_back(answer);
        set.values.push_back(value(j[std::string(answer) + "_probability"]));
    }
    bars.sets.push_back(set);
    TERES_TRY(save_bars(bars, folder / "causes.png"));

    LiverPicture picture;
    const double largest = gap.empty() ? 0.0 : *std::max_element(gap.begin(), gap.end());
    picture.title = "What the named effects change, case " + name;
    picture.value_name = "share of the largest change, " + format("%.1f mm", 1e3 * largest);
    picture.value.assign(mesh.nodes.size(), kNaN);
    for (std::size_t n = 0; n < gap.size(); ++n) {
        const auto node = j["surface"]["node_id"][n].get<std::size_t>();
        if (largest > 0.0 && node < picture.value.size()) picture.value[node] = gap[n] / largest;
    }
    if (j["where"]["center_m"].is_array()) {
        picture.dots.push_back(j["where"]["center_m"].get<Point>());
        picture.dots_name = "place of the cause";
        for (const Json& other : j["where"].value("other_places", Json::array())) {
            picture.dots.push_back(other["center_m"].get<Point>());
            picture.dots_name = "possible places of the cause";
        }
    }
    picture.views = default_views(mesh, sensor, picture.value);
    return save_liver_picture(picture, mesh, folder / "surface_gap.png");
}

void replace(std::string& page, const std::string& mark, const std::string& text) {
    for (std::size_t at = page.find(mark); at != std::string::npos; at = page.find(mark, at + text.size()))
        page.replace(at, mark.size(), text);
}

// Text inside HTML, and JSON inside a script element.
std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
    return out;
}
std::string script_safe(const std::string& json) {
    std::string out;
    for (const char c : json) out += c == '<' ? "\\u003c" : std::string(1, c);
    return out;
}

}  // namespace

std::string verdict_text(const std::string& gap_json) {
    const Json j = Json::parse(gap_json);
    const Json& s = j["shrinkage"];
    const std::string gap = format("%.1f mm", value(j["gap"]["rms_mm"])),
                      floor = format("%.1f mm", value(j["gap"]["noise_floor_mm"]));
    const double none = value(j["none_probability"]), unknown = value(j["unknown_probability"]);
    if (s["effects"].empty()) {
        if (none >= unknown)
            return "Nothing is missing that could be seen: markers and simulation differ by " + gap +
                   " (rms), which noise and the known error of the model explain (" + floor + ").";
        return "Something is missing that is not in the catalogue: markers and simulation differ by " + gap +
               " (rms), far above the " + floor + " of noise and model error, and no known effect explains it" +
               format(" (%.0f %%).", 100.0 * unknown);
    }
    const Json& top = j["causes"][0];
    std::string text = "The gap of " + gap + " (rms) is most likely caused by " + joined(top["effects"], " and ") +
                       format(" (%.0f %%).", 100.0 * value(top["probability"]));
    if (const std::string others = stand_ins(top); !others.empty())
        text += " With these loads and markers it cannot be told from " + others + ".";
    text += std::string(" With it added") +
            (model_error_learned(j) ? " and the model's own error learned from the fitted data," : ",") +
            format(" %.0f %% of the gap is gone", 100.0 * value(s["fraction"])) + " on data that were never fitted (" +
            format("%.2f mm", value(s["before_rms_mm"])) + " to " + format("%.2f mm", value(s["after_rms_mm"])) + ", " +
            s["heldout"].get<std::string>() + ").";
    const Json& where = j["where"];
    if (where["center_m"].is_array()) {
        const auto c = where["center_m"].get<std::vector<double>>();
        text += format(" It lies near x %.0f", 1e3 * c[0]) + format(", y %.0f", 1e3 * c[1]) +
                format(", z %.0f mm", 1e3 * c[2]) +
                (where["onset_s"].is_number() ? format(", from %.1f s on.", value(where["onset_s"])) : ".");
        for (const Json& other : where.value("other_places", Json::array())) {
            const auto o = other["center_m"].get<std::vector<double>>();
            text += format(" It may as well be near x %.0f", 1e3 * o[0]) + format(", y %.0f", 1e3 * o[1]) +
                    format(", z %.0f mm", 1e3 * o[2]) + format(" (odds %.1f).", value(other["odds"]));
        }
    } else if (where["onset_s"].is_number()) {
        text += format(" It begins at %.1f s.", value(where["onset_s"]));
    }
    return text;
}

Status write_gap_report(const std::string& report_json, const TetMeshData& mesh, const SensorData& sensor,
                        const std::filesystem::path& folder) {
    std::error_code failure;
    std::filesystem::create_directories(folder, failure);
    if (failure) return host_fault(folder.string() + ": " + failure.message());
    const Json j = Json::parse(report_json);
    const Residuals r = residuals(j);
    const std::vector<double> gap = surface_gap(j["surface"]);
    std::string page = kGapReportPage;
    replace(page, "@TITLE@", escaped(j["case"].get<std::string>()));
    replace(page, "@VERDICT@", escaped(verdict_text(report_json)));
    replace(page, "@DATA@", script_safe(report_json));
    TERES_TRY(write_text_file(folder / "index.html", page));
    TERES_TRY(write_tables(j, r, gap, folder));
    return draw(j, r, gap, mesh, sensor, folder);
}

}  // namespace teres::tools
