// Effects on the command line: "id" or "id:name=value,name=value". What is not named stays at the middle of
// its prior (shapes) or one standard deviation from null (the first amplitude, if none is named).
#pragma once

#include <string>
#include <vector>

#include "core/extensions/effects.h"
#include "core/result.h"

namespace teres::tools {

struct ChosenEffect {
    std::int32_t index = -1;  ///< in the catalogue that has the id
    bool sensor = false;      ///< of the observation model
    std::vector<double> values;
};

/// Errors (kInvalidInput): unknown id or parameter, a value that is no number or outside of its bounds, an
/// effect that this case cannot show.
Result<ChosenEffect> parse_effect(const std::string& text, const EffectCatalogue& mechanics,
                                  const EffectCatalogue& sensor);

/// Instances that refer to the values of `chosen`, of one of the two catalogues.
std::vector<EffectInstance> instances(const std::vector<ChosenEffect>& chosen, bool sensor);

/// Physical value at the middle of the prior.
double prior_middle(const EffectParameter& parameter);

}  // namespace teres::tools
