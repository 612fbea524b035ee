#include "plugins/diagnosis/gap_json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "plugins/diagnosis/fit_space.h"

namespace teres {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kLeastProbability = 1e-4;  // causes below this are left out, their probability goes to `unknown`
constexpr std::size_t kLeastCauses = 5;     // always shown

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json names(const EffectTable& effects, const std::vector<std::size_t>& entries) {
    Json list = Json::array();
    for (const std::size_t e : entries) list.push_back(effects[e].info.id);
    return list;
}

// A choice is not fitted: an instant lies between two frames (uniformly), a number is what it is. So does the instant
// of a static event, of which derivatives say nothing: every other was tried.
double choice_stdev(const EffectParameter& parameter, const TrajectoryModel& model) {
    const std::size_t last = model.num_frames() - 1;
    if (std::string_view(parameter.unit) != "s" || last == 0) return 0.0;
    return (model.time_s(last) - model.time_s(0)) / static_cast<double>(last) / std::sqrt(12.0);
}

Json parameters(const Cause& cause, const EffectTable& effects, const TrajectoryModel& model,
                const Calibration& calibration) {
    Json list = Json::array();
    if (!cause.fit.usable) return list;
    const FitSpace space(model, effects, cause.fit.at);
    const Eigen::VectorXd stdev = cause.fit.stdev(calibration.nu / cause.fit.cost).cwiseProduct(space.prior_stdev());
    for (std::size_t k = 0; k < cause.entries.size(); ++k) {
        const EffectEntry& entry = effects[cause.entries[k]];
        for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
            const double value = cause.fit.at.effects[k].values[p];
            double spread = stdev(space.coordinate(k, p));
            const bool between_frames = std::string_view(entry.parameters[p].name) == "onset" &&
                                        value > model.time_s(0) && value < model.time_s(model.num_frames() - 1) &&
                                        cause.fit.says_nothing_of(space.coordinate(k, p));
            if (entry.parameters[p].role == EffectRole::kChoice || between_frames)
                spread = choice_stdev(entry.parameters[p], model);
            if (entry.parameters[p].transform == EffectTransform::kLog) spread *= value;  // d exp(q) = exp(q) dq
            Json item{{"name", entry.parameters[p].name},
                      {"unit", entry.parameters[p].unit},
                      {"mean", number(value)},
                      {"stdev", number(spread)}};
            if (cause.entries.size() > 1) item["effect"] = entry.info.id;
            list.push_back(std::move(item));
        }
    }
    return list;
}

// What may stand in for a cause: by first order, by its family, and what was fitted and leaves as little, or no more
// than noise and the model's error, so that nothing in the recording speaks against it.
Json confusable(const Cause& cause, const EffectTable& effects, const Diagnosis& d, const Calibration& calibration) {
    Json list = Json::array();
    std::vector<std::string> seen;
    const auto add = [&](std::size_t e) {
        const std::string id = effects[e].info.id;
        const bool own = std::find(cause.entries.begin(), cause.entries.end(), e) != cause.entries.end();
        if (own || std::find(seen.begin(), seen.end(), id) != seen.end()) return;
        seen.push_back(id);
        list.push_back(id);
    };
    for (const std::size_t e : cause.entries) {
        for (const std::size_t rival : d.confusability.rivals(e, calibration.confusable_overlap)) add(rival);
        for (std::size_t other = 0; other < effects.size(); ++other)
            if (effects[other].applicable() && std::string_view(effects[other].info.family) == effects[e].info.family)
                add(other);
    }
    for (const Cause& other : d.verdict.causes) {
        if (!cause.fit.usable || !other.fit.usable || other.entries.size() != cause.entries.size()) continue;
        const double behind =
            0.5 * calibration.nu * (d.error_floor.log_above(other.left()) - d.error_floor.log_above(cause.left()));
        if (behind < calibration.same_evidence || (d.significant && d.error_floor.explains(other.left())))
            for (const std::size_t e : other.entries) add(e);
    }
    return list;
}

// Two sensors that together may stand in for a sensor that is nothing but amplitudes: the signature of one that was
// also placed or timed is that of another candidate.
Json confusable_pairs(const Cause& cause, const EffectTable& effects, const Diagnosis& d,
                      const Calibration& calibration) {
    Json list = Json::array();
    if (!cause.fit.usable || cause.entries.size() != 1) return list;
    const std::size_t amplitudes = effects.num_amplitudes(cause.entries.front());
    if (amplitudes != effects[cause.entries.front()].parameters.size()) return list;
    const Eigen::VectorXd named = cause.fit.u.tail(static_cast<Eigen::Index>(amplitudes));
    for (const auto& [a, b] : d.confusability.pairs_instead(cause.entries.front(), named, left_of(d.nominal),
                                                            cause.left(), d.error_floor, calibration))
        list.push_back(names(effects, {a, b}));
    return list;
}

std::string held_out_text(const Recording& r, const TrajectoryModel& model) {
    if (r.held_markers.empty())
        return "frames " + std::to_string(r.first_held_frame) + "-" + std::to_string(r.num_frames - 1);
    std::string text = "markers ";
    for (const auto marker : r.held_markers) {
        if (text.back() != ' ') text += ',';
        text += std::to_string(model.marker_id(static_cast<std::size_t>(marker)));
    }
    return text + " in all frames";
}

Json shrinkage_json(const Shrinkage& s) {
    return {{"before_rms_mm", 1e3 * s.before_m},
            {"after_rms_mm", 1e3 * s.after_m},
            {"fraction", number(s.fraction)},
            {"ci95", {number(s.ci95[0]), number(s.ci95[1])}}};
}

Json confusability_json(const Confusability& table, const EffectTable& effects, const Calibration& calibration) {
    Json json;
    json["effects"] = names(effects, table.entries);
    json["visibility_chi2"] = Json::array();
    for (const double v : table.visibility) json["visibility_chi2"].push_back(number(v));
    json["visible"] = Json::array();  // one prior standard deviation would be seen among nu samples
    json["overlap"] = Json::array();
    for (std::size_t c = 0; c < table.entries.size(); ++c) {
        Json row = Json::array();
        for (std::size_t d = 0; d < table.entries.size(); ++d)
            row.push_back(std::round(1e3 * table.overlap(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(d))) /
                          1e3);
        json["overlap"].push_back(std::move(row));
    }
    Json pairs = Json::array();
    for (std::size_t c = 0; c < table.entries.size(); ++c)
        for (std::size_t d = 0; d < table.entries.size(); ++d) {
            const double overlap = table.overlap(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(d));
            if (c == d || overlap < calibration.confusable_overlap) continue;
            const std::string a = effects[table.entries[c]].info.id, b = effects[table.entries[d]].info.id;
            pairs.push_back(
                {{"effect", a}, {"stand_in", b}, {"overlap", overlap}, {"separated_by", separating_experiment(a, b)}});
        }
    json["inseparable"] = std::move(pairs);
    Json absent = Json::array();
    for (std::size_t e = 0; e < effects.size(); ++e)
        if (effects[e].excluded)
            absent.push_back({{"effect", effects[e].info.id}, {"why", "excluded on request"}});
        else if (effects[e].info.not_applicable != nullptr)
            absent.push_back({{"effect", effects[e].info.id}, {"why", effects[e].info.not_applicable}});
    json["not_in_question"] = std::move(absent);
    return json;
}

// Visible: the signature at one prior standard deviation would stand out among nu effective samples of a recording at
// its floor.
Json visible(const Confusability& table, const ErrorFloor& floor, const Calibration& calibration) {
    Json list = Json::array();
    for (const double v : table.visibility)
        list.push_back(0.5 * calibration.nu * std::log1p(v / (2.0 * floor.model)) > calibration.none_bonus);
    return list;
}

Json to_json(const Diagnosis& d, const EffectTable& effects, const TrajectoryModel& model,
             const Calibration& calibration) {
    Json json;
    json["format"] = "teres-gap-1";
    json["case"] = d.name;
    json["gap"] = {{"rms_mm", 1e3 * d.gap_m}, {"noise_floor_mm", 1e3 * d.floor_m}, {"significant", d.significant}};
    Json markers = Json::array();
    for (std::size_t m = 0; m < d.where.marker_share.size(); ++m)
        markers.push_back({{"marker_id", model.marker_id(m)}, {"share", d.where.marker_share[m]}});
    Json others = Json::array();
    for (const OtherPlace& place : d.where.other_places)
        others.push_back({{"center_m", place.center_m}, {"odds", number(place.odds)}});
    json["where"] = {{"kind", d.where.kind},
                     {"center_m", d.where.center_m ? Json(*d.where.center_m) : Json(nullptr)},
                     {"radius_m", d.where.center_m ? number(d.where.radius_m) : Json(nullptr)},
                     {"onset_s", d.where.onset_s ? number(*d.where.onset_s) : Json(nullptr)},
                     {"other_places", std::move(others)},
                     {"markers", std::move(markers)}};
    double unknown = d.verdict.unknown_probability;
    json["causes"] = Json::array();
    for (std::size_t k = 0; k < d.verdict.causes.size(); ++k) {
        const Cause& cause = d.verdict.causes[k];
        if (k >= kLeastCauses && cause.probability < kLeastProbability) {
            unknown += cause.probability;
            continue;
        }
        json["causes"].push_back({{"effects", names(effects, cause.entries)},
                                  {"probability", cause.probability},
                                  {"parameters", parameters(cause, effects, model, calibration)},
                                  {"confusable_with", confusable(cause, effects, d, calibration)},
                                  {"confusable_with_pairs", confusable_pairs(cause, effects, d, calibration)},
                                  {"score", cause.score},
                                  {"explained", cause.explained}});
    }
    json["unknown_probability"] = unknown;
    json["none_probability"] = d.verdict.none_probability;
    const Cause* named = d.named();
    json["shrinkage"] = {{"effects", named != nullptr ? names(effects, named->entries) : Json::array()},
                         {"heldout", held_out_text(d.predicted, model)}};
    json["shrinkage"].update(shrinkage_json(d.shrinkage));
    if (d.best_wrong) {
        json["shrinkage"]["best_wrong"] = {{"effects", d.best_wrong_effects}};
        json["shrinkage"]["best_wrong"].update(shrinkage_json(*d.best_wrong));
    }
    json["next_experiment"] = d.next_experiment;
    json["ladder"] = Json::array();
    for (const LadderStep& step : d.ladder)
        json["ladder"].push_back({{"effects", step.effects},
                                  {"model_error", step.model_error},
                                  {"fitted_rms_mm", 1e3 * step.fit_rms_m},
                                  {"heldout_rms_mm", 1e3 * step.heldout_rms_m}});
    json["transfers"] = Json::array();
    for (const Transfer& t : d.transfers)
        json["transfers"].push_back({{"fitted", t.fitted},
                                     {"predicted", t.predicted},
                                     {"before_rms_mm", 1e3 * t.before_m},
                                     {"after_rms_mm", 1e3 * t.after_m}});
    const double used = static_cast<double>(d.recording.fit_rows.size());
    json["evidence"] = {
        {"cut_short", d.cut_short},
        {"numbers_used", d.recording.fit_rows.size()},
        {"cost_nominal", d.nominal.cost / used},
        {"cost_nominal_later", d.nominal.later / used},  // beyond the fitted frames
        {"cost_named", named != nullptr ? Json(named->fit.cost / used) : Json(nullptr)},
        {"discrepancy_runs", d.discrepancy.runs},
        {"discrepancy_columns", d.discrepancy.columns.cols()},
        {"discrepancy_remainder_mm",
         1e3 * d.discrepancy.remainder_m.norm() / std::sqrt(static_cast<double>(d.discrepancy.remainder_m.size()))},
        {"noise_cost", d.error_floor.noise / used},
        {"model_cost", d.error_floor.model / used},
        {"fits", Json::array()}};
    json["evidence"]["beside_motion"] = {{"cost_nominal", d.nominal.beside / used},
                                         {"noise_cost", d.error_floor.noise_beside / used},
                                         {"model_cost", d.error_floor.model_beside / used}};
    for (const Cause& cause : d.verdict.causes)
        if (cause.fit.usable)
            json["evidence"]["fits"].push_back(
                {{"effects", names(effects, cause.entries)},
                 {"cost", cause.misfit / used},
                 {"cost_beside_motion", cause.fit.beside / used},
                 {"cost_beside_forms",
                  cause.misfit_beside_forms ? Json(*cause.misfit_beside_forms / used) : Json(nullptr)},
                 {"rough_form", cause.rough_form},
                 {"lets_go", cause.lets_go},
                 {"sensors", cause.sensors},
                 {"model_cost", cause.model_error ? Json(*cause.model_error / used) : Json(nullptr)},  // in its state
                 {"score", cause.score},
                 {"tail_nats", cause.price.tail},
                 {"extreme_nats", cause.price.extreme},
                 {"scale_nats", cause.price.scales},
                 {"occam_nats", cause.price.occam},
                 {"search_nats", cause.price.search},
                 {"narrow_nats", cause.price.narrow},
                 {"further_nats", cause.price.further},
                 {"form_nats", cause.form_nats}});
    return json;
}

}  // namespace

std::string gap_json(const Diagnosis& diagnosis, const EffectTable& effects, const TrajectoryModel& model,
                     const Calibration& calibration) {
    return to_json(diagnosis, effects, model, calibration).dump(1) + "\n";
}

std::string plan_json(const Plan& plan, const EffectTable& effects, const Calibration& calibration) {
    Json json{{"format", "teres-plan-1"}, {"case", plan.name}};
    json["identifiability"] = confusability_json(plan.confusability, effects, calibration);
    json["identifiability"]["visible"] = visible(plan.confusability, plan.floor, calibration);
    json["suggestions"] = Json::array();
    for (std::size_t c = 0; c < plan.confusability.entries.size(); ++c)
        if (!json["identifiability"]["visible"][c].get<bool>()) {
            const std::string id = effects[plan.confusability.entries[c]].info.id;
            json["suggestions"].push_back({{"effect", id}, {"made_visible_by", separating_experiment(id, "")}});
        }
    return json.dump(1) + "\n";
}

std::string report_json(const Diagnosis& d, const EffectTable& effects, const TrajectoryModel& model,
                        const Calibration& calibration) {
    Json json = to_json(d, effects, model, calibration);
    json["format"] = "teres-gap-report-1";
    json["identifiability"] = confusability_json(d.confusability, effects, calibration);
    json["identifiability"]["visible"] = visible(d.confusability, d.error_floor, calibration);
    Json summaries = Json::object();
    for (std::size_t e = 0; e < effects.size(); ++e)
        summaries[effects[e].info.id] = {
            {"summary", effects[e].info.summary}, {"kind", effects[e].info.kind}, {"family", effects[e].info.family}};
    json["catalogue"] = std::move(summaries);

    // Where each effect would have to be to explain the gap: stiffness map, force map.
    json["maps"] = Json::array();
    for (const EffectScreening& effect : d.screening.effects) {
        if (effect.places.empty()) continue;
        Json centres = Json::array(), explained = Json::array();
        for (const PlaceGain& place : effect.places) {
            for (const double x : place.centre_m) centres.push_back(std::round(1e6 * x) / 1e6);
            explained.push_back(std::round(1e4 * place.explained) / 1e4);
        }
        json["maps"].push_back({{"effect", effects[effect.entry].info.id},
                                {"center_m", std::move(centres)},
                                {"explained", std::move(explained)}});
    }

    // 0.1 mm is finer than a pixel of any picture.
    const auto tenths = [](double metres) { return std::lround(1e4 * metres); };
    Json times = Json::array(), triangles = Json::array();
    for (std::size_t f = 0; f < model.num_frames(); ++f) times.push_back(model.time_s(f));
    json["time_s"] = std::move(times);
    std::vector<std::int32_t> surface(3 * model.num_surface_triangles());
    model.surface_triangles(surface);
    std::vector<std::int32_t> used(surface.begin(), surface.end());
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    for (const std::int32_t node : surface)
        triangles.push_back(std::lower_bound(used.begin(), used.end(), node) - used.begin());
    json["surface"] = {{"node_id", used}, {"triangle", std::move(triangles)}, {"unit_m", 1e-4}};
    const auto motion = [&](const std::vector<double>& nodes) {
        Json frames = Json::array();
        const std::size_t stride = 3 * model.num_nodes();
        for (std::size_t f = 0; stride > 0 && (f + 1) * stride <= nodes.size(); ++f) {
            Json frame = Json::array();
            for (const std::int32_t node : used)
                for (std::size_t a = 0; a < 3; ++a)
                    frame.push_back(tenths(nodes[f * stride + 3 * static_cast<std::size_t>(node) + a]));
            frames.push_back(std::move(frame));
        }
        return frames;
    };
    json["surface"]["before"] = motion(d.nodes_before_m);
    json["surface"]["after"] = motion(d.nodes_after_m);

    Json marker_ids = Json::array(), observed = Json::array(), before = Json::array(), after = Json::array();
    for (std::size_t m = 0; m < model.num_markers(); ++m) marker_ids.push_back(model.marker_id(m));
    for (Eigen::Index row = 0; row < d.recording.observed.size(); ++row) {
        const double y = d.recording.observed(row);
        observed.push_back(std::isfinite(y) ? Json(std::round(1e6 * y) / 1e6) : Json(nullptr));
        before.push_back(std::round(1e6 * d.nominal.trajectory(row)) / 1e6);
        after.push_back(std::round(1e6 * d.after(row)) / 1e6);
    }
    json["markers"] = {{"marker_id", std::move(marker_ids)},
                       {"observed_m", std::move(observed)},
                       {"before_m", std::move(before)},
                       {"after_m", std::move(after)},
                       {"first_held_frame", d.recording.first_held_frame},
                       {"held_markers", d.recording.held_markers}};
    return json.dump() + "\n";
}

}  // namespace teres
