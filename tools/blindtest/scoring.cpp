#include "tools/blindtest/scoring.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>

#include "tools/blindtest/effect_draws.h"

namespace teres::blindtest {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kVisible = 1.5;         // times the floor
constexpr double kUsualFloor_mm = 0.35;  // without controls

std::vector<std::string> ids_of(const std::string& cause) {
    std::vector<std::string> ids;
    std::istringstream words(cause);
    for (std::string id; std::getline(words, id, '+');) ids.push_back(id);
    return ids;
}

bool is_cause(const std::string& name) {
    return name != "none" && name != "unknown" && name != "failed";
}

std::string family_of(const std::string& id) {
    const EffectKind* kind = find_effect(id);
    return kind != nullptr ? kind->family : id;
}

// Of cause sets: every effect from a sensor, or none of them.
bool is_sensor(const std::string& cause) {
    const auto ids = ids_of(cause);
    return std::all_of(ids.begin(), ids.end(), [](const std::string& id) {
        const EffectKind* kind = find_effect(id);
        return kind != nullptr && std::string(kind->kind) == "sensor";
    });
}

bool same_family(const std::string& answer, const std::string& truth) {
    return is_cause(answer) && ids_of(answer).size() == 1 && family_of(answer) == family_of(truth);
}

Json to_json(const std::optional<double>& value) {
    return value && std::isfinite(*value) ? Json(*value) : Json(nullptr);
}
std::optional<double> number(const Json& json, const char* key) {
    const auto found = json.find(key);
    return found != json.end() && found->is_number() ? std::optional(found->get<double>()) : std::nullopt;
}

std::vector<std::string> strings(const Json& array) {
    std::vector<std::string> list;
    if (array.is_array())
        for (const Json& word : array)
            if (word.is_string()) list.push_back(word.get<std::string>());
    return list;
}
std::vector<std::string> words(const Json& json, const char* key) {
    const auto found = json.find(key);
    return found != json.end() ? strings(*found) : std::vector<std::string>{};
}
// What a cause declares itself inseparable from: single effects and pairs of them.
std::vector<std::string> declared_by(const Json& cause) {
    auto list = words(cause, "confusable_with");
    if (const auto pairs = cause.find("confusable_with_pairs"); pairs != cause.end() && pairs->is_array())
        for (const Json& pair : *pairs)
            if (const auto ids = strings(pair); !ids.empty()) list.push_back(cause_name(ids));
    return list;
}

// Both the contract's file and our own result lines hold an answer in the contract's words.
Json to_json(const Answer& a) {
    Json json{{"format", "teres-gap-1"},
              {"gap", {{"rms_mm", a.gap_rms_mm}}},
              {"where", Json::object()},
              {"causes", Json::array()}};
    json["where"]["center_m"] = a.center_m ? Json(*a.center_m) : Json(nullptr);
    json["where"]["onset_s"] = to_json(a.onset_s);
    for (const auto& [name, probability] : a.causes)
        json["causes"].push_back({{"effects", ids_of(name)}, {"probability", probability}});
    if (!a.causes.empty()) json["causes"][0]["confusable_with"] = a.inseparable;
    json["unknown_probability"] = a.unknown;
    json["none_probability"] = a.none;
    if (a.shrinkage)
        json["shrinkage"] = {{"fraction", (*a.shrinkage)[0]}, {"ci95", {(*a.shrinkage)[1], (*a.shrinkage)[2]}}};
    return json;
}

Result<Answer> answer_from(const Json& json, const std::string& name) {
    if (!json.is_object() || json.value("format", "") != "teres-gap-1")
        return invalid_input(name + ": not of format teres-gap-1");
    Answer answer;
    double sum = 0.0, most = 0.0;
    if (const auto causes = json.find("causes"); causes != json.end() && causes->is_array())
        for (const Json& cause : *causes) {
            const auto effects = words(cause, "effects");
            const auto probability = number(cause, "probability");
            if (effects.empty() || !probability)
                return invalid_input(name + ": a cause without effects or probability");
            if (answer.causes.empty() || *probability > most) {
                most = *probability;
                answer.inseparable = declared_by(cause);
            }
            answer.causes.emplace_back(cause_name(effects), *probability);
            sum += *probability;
        }
    std::stable_sort(answer.causes.begin(), answer.causes.end(), [](auto& a, auto& b) { return a.second > b.second; });
    answer.unknown = number(json, "unknown_probability").value_or(0.0);
    answer.none = number(json, "none_probability").value_or(0.0);
    sum += answer.unknown + answer.none;
    if (!(std::abs(sum - 1.0) < 1e-3))
        return invalid_input(name + ": probabilities sum to " + std::to_string(sum) + ", must be 1");
    if (const auto gap = json.find("gap"); gap != json.end()) answer.gap_rms_mm = number(*gap, "rms_mm").value_or(0.0);
    if (const auto where = json.find("where"); where != json.end() && where->is_object()) {
        answer.onset_s = number(*where, "onset_s");
        const auto center = where->find("center_m");
        if (center != where->end() && center->is_array() && center->size() == 3 &&
            std::all_of(center->begin(), center->end(), [](const Json& x) { return x.is_number(); }))
            answer.center_m = center->get<Point>();
    }
    if (const auto s = json.find("shrinkage"); s != json.end() && s->is_object()) {
        const auto fraction = number(*s, "fraction");
        const auto ci = s->find("ci95");
        if (fraction && ci != s->end() && ci->is_array() && ci->size() == 2 && (*ci)[0].is_number() &&
            (*ci)[1].is_number())
            answer.shrinkage = {*fraction, (*ci)[0].get<double>(), (*ci)[1].get<double>()};
    }
    return answer;
}

double visible_from_mm(const CaseResult& result, const Summary& s) {
    const auto own = s.body_floor_mm.find(result.body);
    return kVisible * (own != s.body_floor_mm.end() ? own->second : s.floor_mm);
}

// Those of the true effects that are visible.
std::vector<std::string> visible_effects(const CaseResult& result, const Summary& s) {
    std::vector<std::string> visible;
    if (result.truth == "none") return visible;
    for (const std::string& id : ids_of(result.truth)) {
        const auto own = result.gap_of_mm.find(id);
        const double gap_mm = own != result.gap_of_mm.end() ? own->second : result.gap_nominal_mm;
        if (gap_mm > visible_from_mm(result, s)) visible.push_back(id);
    }
    return visible;
}

// Every visible effect is named, and no effect that was not there.
bool is_right(const std::string& answer, const std::string& truth, const std::vector<std::string>& visible) {
    if (answer == truth) return true;
    if (answer == "none") return visible.empty();
    const auto named = ids_of(answer), there = ids_of(truth);
    const auto among = [](const std::vector<std::string>& ids) {
        return [&ids](const std::string& id) { return std::count(ids.begin(), ids.end(), id) != 0; };
    };
    return is_cause(answer) && std::all_of(visible.begin(), visible.end(), among(named)) &&
           std::all_of(named.begin(), named.end(), among(there));
}

// Floors of the bodies that have a control.
std::map<std::string, double> control_floors(std::span<const CaseResult> results) {
    std::map<std::string, std::vector<double>> gaps;
    for (const CaseResult& r : results)
        if (r.truth == "none" && r.answer)
            gaps[r.body].push_back(
                std::sqrt(std::max(0.0, r.answer->gap_rms_mm * r.answer->gap_rms_mm - r.noise_mm * r.noise_mm)));
    std::map<std::string, double> floors;
    for (const auto& [body, list] : gaps) floors[body] = median(list);
    return floors;
}

void add_single(const CaseResult& r, const std::string& best, bool visible, Summary& s) {
    const auto& causes = r.answer->causes;
    const bool top1 = best == r.truth;
    const bool top3 = std::any_of(causes.begin(),
                                  causes.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(3, causes.size())),
                                  [&](const auto& cause) { return cause.first == r.truth; });
    s.top1_all.add(top1);
    s.top3_all.add(top3);
    if (!visible) {
        s.invisible_none.add(best == "none");
        return;
    }
    EffectRow& row = s.effects[r.truth];
    ++row.visible;
    for (auto* share : {&s.top1, &row.top1}) share->add(top1);
    for (auto* share : {&s.top3, &row.top3}) share->add(top3);
    const auto& also = r.answer->inseparable;
    const auto declared = [&](const std::string& id) { return std::count(also.begin(), also.end(), id) != 0; };
    s.declared.add(top1 || (is_cause(best) && declared(r.truth)));
    for (auto* share : {&s.family, &row.family}) share->add(top1 || same_family(best, r.truth));
    if (is_cause(best)) s.kind.add(is_sensor(best) == is_sensor(r.truth));
    s.false_unknown.add(best == "unknown");
    if (r.withheld) {
        const std::string instead = r.withheld->best().first;
        const bool unknown = instead == "unknown" || same_family(instead, r.truth);
        s.withheld_unknown.add(unknown);
        s.withheld_declared.add(unknown || (top1 && declared(instead)) || (instead == best && declared(r.truth)));
    }
    if (top1 && r.place_error_mm) {
        s.place_mm.push_back(*r.place_error_mm);
        row.place_mm.push_back(*r.place_error_mm);
    }
    if (r.true_shrinkage && is_cause(best)) (top1 ? s.true_shrinkage : s.wrong_shrinkage).push_back(*r.true_shrinkage);
    if (r.true_shrinkage && r.answer->shrinkage && top1 && !is_sensor(r.truth))  // a sensor does not move inner points
        s.coverage.add(*r.true_shrinkage >= (*r.answer->shrinkage)[1] &&
                       *r.true_shrinkage <= (*r.answer->shrinkage)[2]);
}

}  // namespace

std::string cause_name(std::vector<std::string> effects) {
    if (effects.empty()) return "none";
    std::sort(effects.begin(), effects.end());
    std::string name = effects.front();
    for (std::size_t i = 1; i < effects.size(); ++i) name += "+" + effects[i];
    return name;
}

std::pair<std::string, double> Answer::best() const {
    std::pair<std::string, double> best{"none", none};
    if (unknown > best.second) best = {"unknown", unknown};
    if (!causes.empty() && causes.front().second > best.second) best = causes.front();
    return best;
}

Result<Answer> parse_answer(std::string_view json, const std::string& name) {
    return answer_from(Json::parse(json, nullptr, false), name);
}

std::string to_json_line(const CaseResult& r) {
    return Json{{"case", r.name},
                {"truth", r.truth},
                {"body", r.body},
                {"located", r.located},
                {"gap_nominal_mm", r.gap_nominal_mm},
                {"gap_of_mm", r.gap_of_mm},
                {"noise_mm", r.noise_mm},
                {"answer", r.answer ? to_json(*r.answer) : Json(nullptr)},
                {"place_error_mm", to_json(r.place_error_mm)},
                {"onset_error_s", to_json(r.onset_error_s)},
                {"true_shrinkage", to_json(r.true_shrinkage)},
                {"withheld", r.withheld ? to_json(*r.withheld) : Json(nullptr)},
                {"seconds", r.seconds},
                {"peak_mb", r.peak_mb}}
        .dump();
}

Result<CaseResult> parse_case_result(std::string_view line, const std::string& place) {
    const Json json = Json::parse(line, nullptr, false);
    if (!json.is_object() || !json.contains("case") || !json["case"].is_string() || !json.contains("truth") ||
        !json["truth"].is_string())
        return invalid_input(place + ": not a result of teres blindtest");
    CaseResult r;
    r.name = json["case"].get<std::string>();
    r.truth = json["truth"].get<std::string>();
    r.body = json.value("body", "");
    r.located = json.value("located", false);
    r.gap_nominal_mm = number(json, "gap_nominal_mm").value_or(0.0);
    r.noise_mm = number(json, "noise_mm").value_or(0.0);
    if (const auto each = json.find("gap_of_mm"); each != json.end() && each->is_object())
        for (const auto& [id, gap] : each->items())
            if (gap.is_number()) r.gap_of_mm[id] = gap.get<double>();
    r.place_error_mm = number(json, "place_error_mm");
    r.onset_error_s = number(json, "onset_error_s");
    r.true_shrinkage = number(json, "true_shrinkage");
    r.seconds = number(json, "seconds").value_or(0.0);
    r.peak_mb = number(json, "peak_mb").value_or(0.0);
    for (const auto& [key, out] : {std::pair{"answer", &r.answer}, std::pair{"withheld", &r.withheld}}) {
        if (!json.contains(key) || json[key].is_null()) continue;
        TERES_TRY_ASSIGN(*out, answer_from(json[key], place));
    }
    return r;
}

double median(std::vector<double> values) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::sort(values.begin(), values.end());
    const std::size_t n = values.size();
    return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

double mean_deviation(std::span<const double> probabilities) {
    std::vector<double> happens{1.0};  // probability that so many do
    for (const double p : probabilities) {
        happens.push_back(0.0);
        for (std::size_t k = happens.size(); k-- > 1;) happens[k] = (1.0 - p) * happens[k] + p * happens[k - 1];
        happens[0] *= 1.0 - p;
    }
    const double mean = std::accumulate(probabilities.begin(), probabilities.end(), 0.0);
    double deviation = 0.0;
    for (std::size_t k = 0; k < happens.size(); ++k) deviation += happens[k] * std::abs(static_cast<double>(k) - mean);
    return deviation;
}

Summary summarise(std::span<const CaseResult> results, std::optional<double> floor_mm) {
    Summary s;
    if (!floor_mm) s.body_floor_mm = control_floors(results);
    std::vector<double> floors;
    for (const auto& [body, floor] : s.body_floor_mm) floors.push_back(floor);
    s.floor_mm = floor_mm.value_or(floors.empty() ? kUsualFloor_mm : median(floors));
    std::array<std::vector<double>, 10> stated;
    for (const CaseResult& r : results) {
        if (!r.answer) {
            ++s.failed;
            continue;
        }
        s.seconds.push_back(r.seconds);
        s.peak_mb.push_back(r.peak_mb);
        const auto [best, probability] = r.answer->best();
        const auto causes = ids_of(r.truth);
        const auto seen = visible_effects(r, s);
        const bool control = r.truth == "none", visible = !seen.empty();
        const bool right = is_right(best, r.truth, seen);
        if (control) {
            s.false_alarm.add(best != "none");
        } else if (causes.size() == 1) {
            add_single(r, best, visible, s);
        } else if (visible && seen.size() < causes.size()) {
            s.two_seen.add(right);
        } else if (visible) {
            const auto named = ids_of(best);
            s.two_both.add(best == r.truth);
            s.two_one.add(std::any_of(named.begin(), named.end(), [&](const std::string& id) {
                return std::count(causes.begin(), causes.end(), id) != 0;
            }));
        }
        if (control || visible) ++s.confusion[r.truth][best];
        const auto bin = std::min<std::size_t>(9, static_cast<std::size_t>(10.0 * probability));
        s.reliability[bin].right.add(right);
        stated[bin].push_back(probability);
    }
    double total = 0.0;
    for (std::size_t b = 0; b < 10; ++b) {
        ReliabilityBin& bin = s.reliability[b];
        if (bin.right.of == 0) continue;
        const double sum = std::accumulate(stated[b].begin(), stated[b].end(), 0.0);
        bin.mean_probability = sum / bin.right.of;
        total += bin.right.of;
        s.ece += std::abs(sum - bin.right.right);  // sum of n |confidence - accuracy|
        s.ece_of_chance += mean_deviation(stated[b]);
    }
    if (total > 0.0) {
        s.ece /= total;
        s.ece_of_chance /= total;
    }
    return s;
}

}  // namespace teres::blindtest
