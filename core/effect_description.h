// What an effect tells of itself (core/extensions/effects.h), and the small vocabulary in which effect files
// write it.
//
//     d.parameters = {amplitude("ratio", "1", EffectTransform::kLog, 1.0, 0.7, 0.1, 10.0),
//                     shape("center_x", "m", centre, spread, lower, upper)};
//     for (double x : places) d.candidates.push_back({one_sigma(d.parameters[0]), x});
#pragma once

#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/extensions/effects.h"

namespace teres {

struct EffectDescription {
    const char *id = "", *kind = "", *family = "", *summary = "", *source = "";
    bool event = false;
    std::string not_applicable;  ///< empty: this case can show it
    std::vector<EffectParameter> parameters;
    std::vector<std::vector<double>> candidates;
    std::optional<std::size_t> surface_centre;  ///< parameter center_x of a place that lies on the surface

    EffectInfo info() const {
        return {id,
                kind,
                family,
                summary,
                source,
                not_applicable.empty() ? nullptr : not_applicable.c_str(),
                static_cast<std::int32_t>(parameters.size()),
                static_cast<std::int32_t>(candidates.size()),
                event};
    }
};

inline EffectParameter amplitude(const char* name, const char* unit, EffectTransform transform, double null_value,
                                 double prior_stdev, double lower, double upper) {
    const double mean = transform == EffectTransform::kLog ? std::log(null_value) : null_value;
    return {name, unit, EffectRole::kAmplitude, transform, null_value, mean, prior_stdev, lower, upper};
}

inline EffectParameter shape(const char* name, const char* unit, double mean, double stdev, double lower,
                             double upper) {
    return {name, unit, EffectRole::kShape, EffectTransform::kIdentity, mean, mean, stdev, lower, upper};
}

/// Shape in which the effect jumps; found by trying.
inline EffectParameter choice(const char* name, const char* unit, double mean, double stdev, double lower,
                              double upper) {
    return {name, unit, EffectRole::kChoice, EffectTransform::kIdentity, mean, mean, stdev, lower, upper};
}

/// Shape that is positive: radius, frequency, time constant; `stdev` is that of its logarithm.
inline EffectParameter log_shape(const char* name, const char* unit, double median, double stdev, double lower,
                                 double upper) {
    return {name, unit, EffectRole::kShape, EffectTransform::kLog, median, std::log(median), stdev, lower, upper};
}

/// Physical value one prior standard deviation above the prior's centre.
inline double one_sigma(const EffectParameter& p) {
    const double value = p.prior_mean + p.prior_stdev;
    return p.transform == EffectTransform::kLog ? std::exp(value) : value;
}

/// Candidate with every amplitude at one standard deviation and every shape at its prior centre.
inline std::vector<double> central_candidate(const std::vector<EffectParameter>& parameters) {
    std::vector<double> values;
    for (const auto& p : parameters)
        values.push_back(p.role == EffectRole::kAmplitude       ? one_sigma(p)
                         : p.transform == EffectTransform::kLog ? std::exp(p.prior_mean)
                                                                : p.prior_mean);
    return values;
}

/// True if every amplitude is at its null value: the effect is absent.
inline bool is_null(const EffectDescription& d, std::span<const double> values) {
    for (std::size_t i = 0; i < d.parameters.size(); ++i)
        if (d.parameters[i].role == EffectRole::kAmplitude && values[i] != d.parameters[i].null_value) return false;
    return true;
}

}  // namespace teres
