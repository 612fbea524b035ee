#include "plugins/diagnosis/judged_again.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "plugins/diagnosis/verdict.h"

namespace teres {
namespace {

using Json = nlohmann::ordered_json;

std::optional<double> known(const Json& value) {
    return value.is_null() ? std::nullopt : std::optional(value.get<double>());
}

// Numbers of effects in the order of their first mention: judge() only tells sets apart.
class Numbered {
  public:
    std::vector<std::size_t> entries(const Json& effects) {
        std::vector<std::size_t> out;
        for (const Json& effect : effects) {
            const auto id = effect.get<std::string>();
            const auto at = std::find(ids_.begin(), ids_.end(), id);
            out.push_back(static_cast<std::size_t>(at - ids_.begin()));
            if (at == ids_.end()) ids_.push_back(id);
        }
        return out;
    }

  private:
    std::vector<std::string> ids_;
};

// The floor of the costs per used number: judge() compares ratios of costs.
ErrorFloor floor_of(const Json& evidence) {
    const Json& beside = evidence.at("beside_motion");
    ErrorFloor floor;
    floor.noise = evidence.at("noise_cost").get<double>();
    floor.model = evidence.at("model_cost").get<double>();
    floor.noise_beside = beside.at("noise_cost").get<double>();
    floor.model_beside = beside.at("model_cost").get<double>();
    return floor;
}

Cause fitted(const Json& fit) {
    Cause cause;
    cause.fit.usable = true;
    cause.misfit = fit.at("cost").get<double>();
    cause.fit.beside = fit.at("cost_beside_motion").get<double>();
    cause.misfit_beside_forms = known(fit.at("cost_beside_forms"));
    cause.model_error = known(fit.at("model_cost"));
    cause.rough_form = fit.at("rough_form").get<bool>();
    cause.lets_go = fit.at("lets_go").get<bool>();
    cause.sensors = fit.value("sensors", false);  // older evidence does not say
    const auto nats = [&](const char* name) { return fit.at(name).get<double>(); };
    cause.price = {nats("tail_nats"),   nats("extreme_nats"), nats("scale_nats"),  nats("occam_nats"),
                   nats("search_nats"), nats("narrow_nats"),  nats("further_nats")};
    cause.form_nats = fit.value("form_nats", 0.0);  // older evidence has none
    return cause;
}

Json judged(Json answer, const Calibration& calibration) {
    const Json& evidence = answer.at("evidence");
    const Left nominal{evidence.at("cost_nominal").get<double>() + evidence.at("cost_nominal_later").get<double>(),
                       evidence.at("beside_motion").at("cost_nominal").get<double>()};
    Numbered effects;
    std::vector<Cause> causes;
    std::vector<Json> as_answered;
    for (const Json& listed : answer.at("causes")) {
        const Json& ids = listed.at("effects");
        const Json& fits = evidence.at("fits");
        const auto fit = std::find_if(fits.begin(), fits.end(),
                                      [&](const Json& candidate) { return candidate.at("effects") == ids; });
        Cause cause = fit != fits.end() ? fitted(*fit) : Cause{};
        cause.entries = effects.entries(ids);
        cause.score = listed.at("score").get<double>();
        causes.push_back(std::move(cause));
        as_answered.push_back(listed);
    }
    const Verdict verdict = judge(causes, nominal, floor_of(evidence), calibration);
    answer["causes"] = Json::array();
    for (const Cause& cause : verdict.causes) {
        const auto at = std::find_if(causes.begin(), causes.end(),
                                     [&](const Cause& before) { return before.entries == cause.entries; });
        answer["causes"].push_back(std::move(as_answered[static_cast<std::size_t>(at - causes.begin())]));
        answer["causes"].back()["probability"] = cause.probability;
    }
    answer["unknown_probability"] = verdict.unknown_probability;
    answer["none_probability"] = verdict.none_probability;
    answer["gap"]["significant"] = verdict.none_probability < 0.5;
    return answer;
}

}  // namespace

Result<std::string> judged_again(const std::string& gap_json, const Calibration& calibration) {
    try {
        Json answer = Json::parse(gap_json);
        if (!answer.is_object() || answer.value("format", "") != "teres-gap-1")
            return invalid_input("not a diagnosis (teres-gap-1)");
        return judged(std::move(answer), calibration).dump(1) + "\n";
    } catch (const Json::exception& e) {
        return invalid_input(std::string("not the evidence of a diagnosis (teres-gap-1): ") + e.what());
    }
}

}  // namespace teres
