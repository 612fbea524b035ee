// Effects as every unit sees them: what the nominal model leaves out, as named parameters with a prior.
// Crosses a plugin boundary: plain structs, spans, no exceptions, no ownership.
//
// An effect has amplitude parameters, which are at their null value when the effect is absent, and shape parameters
// (place, radius, onset, frequency), which mean nothing then. A candidate is a full parameter vector with every
// amplitude one prior standard deviation away from null and the shape at a point of the effect's search grid. An
// amplitude that plays no part at that point (the swap of a slipped marker) stays at null there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace teres {

/// A choice is a shape in which the effect jumps (which marker, from which frame on): no descent leads to it.
enum class EffectRole : std::int32_t { kAmplitude = 0, kShape = 1, kChoice = 2 };
enum class EffectTransform : std::int32_t { kIdentity = 0, kLog = 1 };  ///< of the prior and of the estimation

struct EffectParameter {
    const char* name;  ///< e.g. "center_x"; valid while the model lives
    const char* unit;  ///< SI, "1" for ratios
    EffectRole role;
    EffectTransform transform;
    double null_value;    ///< physical value at which the effect vanishes (amplitudes)
    double prior_mean;    ///< of the transformed value
    double prior_stdev;   ///< of the transformed value
    double lower, upper;  ///< physical bounds
};

struct EffectInfo {
    const char* id;              ///< fixed ids of the catalogue
    const char* kind;            ///< "mechanics", "boundary", "load", "sensor"
    const char* family;          ///< effects of one family may be inseparable
    const char* summary;         ///< one sentence for users
    const char* source;          ///< of the prior's range
    const char* not_applicable;  ///< null, or why this case cannot show it ("no tool moves", "quasi-static recording")
    std::int32_t num_parameters;
    std::int32_t num_candidates;
    bool event;  ///< has an onset: what is learnt before it does not predict what comes after
};

/// One effect switched on: `values` has effect(index).num_parameters physical values.
struct EffectInstance {
    std::int32_t index;  ///< in the catalogue of the model that is called
    std::span<const double> values;
};

/// Part shared by the mechanical and the sensor model.
class EffectCatalogue {
  public:
    virtual std::size_t num_effects() const noexcept = 0;
    virtual EffectInfo effect(std::size_t index) const noexcept = 0;
    virtual EffectParameter effect_parameter(std::size_t effect, std::size_t parameter) const noexcept = 0;
    /// Writes candidate `candidate` of the effect (num_parameters values).
    virtual void effect_candidate(std::size_t effect, std::size_t candidate,
                                  std::span<double> values) const noexcept = 0;

  protected:
    ~EffectCatalogue() = default;
};

}  // namespace teres
