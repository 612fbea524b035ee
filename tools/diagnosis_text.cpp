#include "tools/diagnosis_text.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

namespace teres::tools {
namespace {

using Json = nlohmann::ordered_json;

std::string joined(const Json& names, const char* separator = " + ") {
    std::string text;
    for (const auto& name : names) text += (text.empty() ? "" : separator) + name.get<std::string>();
    return text;
}

}  // namespace

std::string stand_ins(const Json& cause) {
    std::string text = joined(cause["confusable_with"], ", ");
    for (const auto& pair : cause.value("confusable_with_pairs", Json::array()))
        text += (text.empty() ? "" : ", ") + joined(pair, " with ");
    return text;
}

void print_gap(const Json& j) {
    const Json &gap = j["gap"], &s = j["shrinkage"];
    std::printf("%s: gap %.2f mm, floor of noise and model error %.2f mm\n", j["case"].get<std::string>().c_str(),
                gap["rms_mm"].get<double>(), gap["noise_floor_mm"].get<double>());
    if (j["evidence"]["cut_short"].get<bool>())
        std::printf(
            "  cut short at the limit of processor time (diagnosis.work_limit_s; with inertia work_limit_dynamic_s): "
            "not all was tried\n");
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
            rows.push_back({joined(cause["effects"]), cause["probability"].get<double>(), stand_ins(cause)});
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
                        ((step["effects"].empty() ? "nominal" : joined(step["effects"])) +
                         (step["model_error"].get<bool>() ? " + model error" : ""))
                            .c_str(),
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

}  // namespace teres::tools
