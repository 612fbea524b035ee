// The gap diagnosis as offline commands see it: recordings of one body in, a verdict out. Crosses a plugin boundary:
// plain structs, spans, UTF-8 JSON text, no exceptions, no ownership.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/extensions/trajectory_model.h"

namespace teres {

/// One recording and the models of it. All pointers and spans must live until diagnose() returns.
struct GapRecording {
    const char* name;
    TrajectoryModel* mechanics;
    const ObservationModel* sensors;     ///< null: no sensor effects
    std::span<const double> observed_m;  ///< 3 markers x frames, layout of TrajectoryModel; NaN: lost
    double noise_sigma_m;                ///< stated, per axis
    std::uint64_t body_hash;             ///< of mesh, law, supports and markers: names the cache

    // A long dynamic recording is fitted on its beginning (the models above); these are of all of it. Null: those above
    // are.
    TrajectoryModel* whole_mechanics = nullptr;
    const ObservationModel* whole_sensors = nullptr;
    std::span<const double> whole_observed_m{};
};

struct GapRequest {
    std::span<const GapRecording> recordings;  ///< the first is fitted and named, the others only predicted
    std::span<const char* const> excluded;     ///< effect ids left out of the catalogue
    const char* cache_folder;                  ///< of discrepancy ensembles; empty: none is kept
    bool plan_only;                            ///< identifiability from signatures alone, observations unused
    std::int32_t max_effects;                  ///< simultaneous effects, >= 1
    bool (*progress)(void* user, const char* stage, double part);  ///< part in [0, 1]; false cancels; may be null
    void* user;
};

class GapDiagnosis {
  public:
    static constexpr const char* kId = "teres.gap_diagnosis/4";

    /// [setup] 0, or an exit code of the commands (1 not usable, 2 bad input); then error() says why.
    virtual std::int32_t diagnose(const GapRequest& request) noexcept = 0;
    /// [setup] The same of an answer ("teres-gap-1") that was made before: its evidence judged by this program, nothing
    /// fitted. After it only gap_json() is valid.
    virtual std::int32_t judge_again(const char* gap_json) noexcept = 0;
    virtual const char* error() const noexcept = 0;

    // [setup] After either returned 0; valid until the next call.
    virtual const char* gap_json() const noexcept = 0;     ///< "teres-gap-1" (plan_only: "teres-plan-1")
    virtual const char* report_json() const noexcept = 0;  ///< what the report draws: "teres-gap-report-1"
    /// Validation points of the first recording (all of it) with the named effects added and with the model's own error
    /// as far as the fitted data show it: f * 3 P + 3 p + a.
    virtual std::span<const double> points_m() const noexcept = 0;
    /// The same under the nominal fit, without any effect.
    virtual std::span<const double> nominal_points_m() const noexcept = 0;

  protected:
    ~GapDiagnosis() = default;
};

}  // namespace teres
