#include "tools/effect_options.h"

#include <cmath>
#include <cstdlib>
#include <sstream>

namespace teres::tools {

namespace {

std::string number(double value) {
    std::ostringstream text;
    text << value;
    return text.str();
}

Result<ChosenEffect> find(const std::string& id, const EffectCatalogue& mechanics, const EffectCatalogue& sensor) {
    std::string known;
    for (const bool is_sensor : {false, true}) {
        const EffectCatalogue& catalogue = is_sensor ? sensor : mechanics;
        for (std::size_t e = 0; e < catalogue.num_effects(); ++e) {
            const EffectInfo info = catalogue.effect(e);
            if (id == info.id) {
                if (info.not_applicable != nullptr)
                    return invalid_input("--effect " + id + ": this case cannot show it: " + info.not_applicable);
                return ChosenEffect{static_cast<std::int32_t>(e), is_sensor, {}};
            }
            known += std::string(known.empty() ? "" : ", ") + info.id;
        }
    }
    return invalid_input("--effect " + id + " is no effect of the catalogue (" + known + ")");
}

}  // namespace

double prior_middle(const EffectParameter& p) {
    return p.transform == EffectTransform::kLog ? std::exp(p.prior_mean) : p.prior_mean;
}

Result<ChosenEffect> parse_effect(const std::string& text, const EffectCatalogue& mechanics,
                                  const EffectCatalogue& sensor) {
    const std::size_t colon = text.find(':');
    TERES_TRY_ASSIGN(ChosenEffect chosen, find(text.substr(0, colon), mechanics, sensor));
    const EffectCatalogue& catalogue = chosen.sensor ? sensor : mechanics;
    const auto effect = static_cast<std::size_t>(chosen.index);
    std::vector<EffectParameter> parameters;
    for (std::int32_t p = 0; p < catalogue.effect(effect).num_parameters; ++p) {
        parameters.push_back(catalogue.effect_parameter(effect, static_cast<std::size_t>(p)));
        const EffectParameter& parameter = parameters.back();
        chosen.values.push_back(parameter.role == EffectRole::kAmplitude ? parameter.null_value
                                                                         : prior_middle(parameter));
    }
    bool amplitude_given = false;
    std::istringstream assignments(colon == std::string::npos ? "" : text.substr(colon + 1));
    for (std::string assignment; std::getline(assignments, assignment, ',');) {
        const std::size_t equals = assignment.find('=');
        const std::string name = assignment.substr(0, equals);
        std::size_t p = 0;
        while (p < parameters.size() && name != parameters[p].name) ++p;
        if (p == parameters.size() || equals == std::string::npos) {
            std::string known;
            for (const auto& parameter : parameters) known += std::string(known.empty() ? "" : ", ") + parameter.name;
            return invalid_input("--effect " + text + ": \"" + assignment + "\" is not NAME=VALUE with a name of " +
                                 known);
        }
        const std::string digits = assignment.substr(equals + 1);
        char* end = nullptr;
        const double value = std::strtod(digits.c_str(), &end);
        if (digits.empty() || *end != '\0' || !(value >= parameters[p].lower && value <= parameters[p].upper))
            return invalid_input("--effect " + text + ": " + name + " = " + digits + " must lie between " +
                                 number(parameters[p].lower) + " and " + number(parameters[p].upper) + " " +
                                 parameters[p].unit);
        chosen.values[p] = value;
        amplitude_given = amplitude_given || parameters[p].role == EffectRole::kAmplitude;
    }
    if (!amplitude_given && catalogue.effect(effect).num_candidates > 0) {
        std::vector<double> candidate(parameters.size());
        catalogue.effect_candidate(effect, 0, candidate);
        for (std::size_t p = 0; p < parameters.size(); ++p)
            if (parameters[p].role == EffectRole::kAmplitude) {
                chosen.values[p] = candidate[p];
                break;
            }
    }
    return chosen;
}

std::vector<EffectInstance> instances(const std::vector<ChosenEffect>& chosen, bool sensor) {
    std::vector<EffectInstance> out;
    for (const auto& effect : chosen)
        if (effect.sensor == sensor) out.push_back({effect.index, effect.values});
    return out;
}

}  // namespace teres::tools
