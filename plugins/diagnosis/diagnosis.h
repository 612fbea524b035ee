// The gap between a recording and its simulation: where it lies, which unmodelled effect causes it, how far it shrinks.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/extensions/gap_diagnosis.h"
#include "core/result.h"
#include "plugins/diagnosis/calibration.h"
#include "plugins/diagnosis/confusability.h"
#include "plugins/diagnosis/discrepancy.h"
#include "plugins/diagnosis/held_out.h"
#include "plugins/diagnosis/recording.h"
#include "plugins/diagnosis/verdict.h"

namespace teres {

struct DiagnosisOptions {
    std::vector<const char*> excluded;
    std::filesystem::path cache;
    int max_effects = 3;
    int num_refits = 5;
    double work_limit_s = 0.0;  ///< of processor time, then no further search is begun; 0: none
    Calibration calibration{};
    /// False cancels.
    std::function<bool(const char* stage, double part)> progress{};
};

/// Where the gap lies.
struct Where {
    std::string kind = "none";  ///< mechanics, boundary, load, sensor, none
    std::optional<std::array<double, 3>> center_m;
    double radius_m = 0.0;
    std::vector<OtherPlace> other_places;  ///< of a single cause
    std::optional<double> onset_s;
    std::vector<double> marker_share;  ///< of the nominal gap's square, per marker
};

/// The gap after each effect was added, on fitted and on held-out data; last with the model's own error as well
/// (learned_error.h).
struct LadderStep {
    std::vector<std::string> effects;
    double fit_rms_m = 0.0, heldout_rms_m = 0.0;
    bool model_error = false;
};

/// Another recording of the same body under what this one taught.
struct Transfer {
    std::string fitted, predicted;
    double before_m = 0.0, after_m = 0.0;
};

struct Diagnosis {
    std::string name;
    double gap_m = 0.0, floor_m = 0.0;  ///< rms 3-D distance of the nominal fit; what noise and model error explain
    ErrorFloor error_floor;
    bool significant = false;
    bool cut_short = false;  ///< by work_limit_s
    Verdict verdict;
    Fit nominal;
    Recording recording;
    Recording predicted;  ///< what shrinkage and ladder are held out of: `recording`, or all of it if only its
                          ///< beginning was fitted
    Screening screening;
    Confusability confusability;
    Discrepancy discrepancy;
    Shrinkage shrinkage;
    std::optional<Shrinkage> best_wrong;  ///< of the best cause of another family
    std::vector<std::string> best_wrong_effects;
    std::vector<LadderStep> ladder;
    std::vector<Transfer> transfers;
    Where where;
    std::string next_experiment;
    std::vector<double> points_m;          ///< validation points with the named effects and the model's own error
    std::vector<double> nominal_points_m;  ///< ... with neither
    std::vector<double> nodes_before_m, nodes_after_m;  ///< all nodes per frame
    Eigen::VectorXd after;                              ///< markers with the named effects and the model's own error

    /// The named answer: the most probable cause, or null if `none` or `unknown` is more probable.
    const Cause* named() const;
};

/// Errors: recording.h; kNotUsable if the nominal model does not converge.
Result<Diagnosis> diagnose(std::span<const GapRecording> recordings, const EffectTable& effects,
                           const DiagnosisOptions& options);

/// Identifiability alone: signatures about the prior median; the observations are not looked at.
struct Plan {
    std::string name;
    Screening screening;
    Confusability confusability;
    ErrorFloor floor;
};
Result<Plan> plan(const GapRecording& recording, const EffectTable& effects, const DiagnosisOptions& options);

}  // namespace teres
