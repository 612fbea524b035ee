// The effects of the catalogue as CalculiX or a camera makes them, drawn at random: other forms than the diagnoser's
// own (sharp ellipsoid, slab cut, spring bed, breathing curve, pulse with harmonic, wavy depth bias, ...).
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "tools/blindtest/truth_body.h"

namespace teres::blindtest {

/// What was done, for the sealed label.
struct EffectTruth {
    std::string id;
    nlohmann::ordered_json parameters = nlohmann::ordered_json::object();  ///< names carry units
    std::optional<Point> center_m;
    double radius_m = 0.0;
    std::optional<double> onset_s;
    std::vector<std::int32_t> markers;  ///< of a sensor effect on single markers
};

struct EffectKind {
    const char* id;
    const char* kind;    ///< "mechanics", "boundary", "load", "sensor"
    const char* family;  ///< effects of one family may be inseparable; as in `teres effects`
    bool needs_clamp, needs_dynamics, event;
};
/// The 26 ids of DESIGN section 4.
const std::vector<EffectKind>& effect_kinds();
const EffectKind* find_effect(const std::string& id);

/// Draws a mechanical effect (not "sensor") into the scenario. Sizes of load-like effects are drawn as rms displacement
/// of the markers and found by a linear solution. Errors: of CalculiX; kNotUsable: no place was found.
Result<EffectTruth> draw_mechanics(const std::string& id, Random& random, const TruthBody& body, Scenario& scenario,
                                   const std::filesystem::path& scratch);

/// Draws a sensor effect and applies it to the marker positions [frame][marker]. "noise" only sets `noise_factor` and
/// `depth_step_m` (quantisation along the view direction), which the observer applies last.
struct SensorState {
    Frames seen;
    double noise_factor = 1.0;
    double depth_step_m = 0.0;
};
EffectTruth draw_sensor(const std::string& id, Random& random, const Case& nominal, SensorState& state);

}  // namespace teres::blindtest
