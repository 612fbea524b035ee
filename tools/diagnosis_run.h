// The gap diagnosis offline: one session of units per recording, the unit `diagnosis` of the first one over all of
// them.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/config.h"
#include "core/extensions/gap_diagnosis.h"
#include "core/result.h"
#include "core/session.h"

namespace teres::tools {

struct DiagnosisRunOptions {
    std::vector<std::string> excluded;
    std::string cache_folder;   ///< of discrepancy ensembles; empty: none is kept
    std::string settings_text;  ///< what was set, as text: part of the cache's key
    bool plan_only = false;
    int max_effects = 3;
    std::function<void(const std::string& stage, double part)> progress{};
};

struct DiagnosisRun {
    std::string gap_json, report_json;
    std::vector<double> time_s;  ///< of the frames of the first recording
    std::vector<std::int32_t> point_id;
    std::vector<double> points_m;          ///< 3 per point and frame, with the named effects
    std::vector<double> nominal_points_m;  ///< ... without any
};

/// $XDG_CACHE_HOME/teres, else ~/.cache/teres; empty if there is neither.
std::string default_cache_folder();

/// Errors: a bad case or effect name; recordings of different bodies; nothing that moves the body (kInvalidInput);
/// a nominal model that does not converge (kNotUsable).
Result<DiagnosisRun> diagnose_cases(const std::vector<std::string>& case_folders, const Config& config,
                                    const DiagnosisRunOptions& options);

/// The unit `diagnosis` without a recording: judges answers again that were made before.
class Judge {
  public:
    static Result<Judge> open(Config config);
    /// "teres-gap-1" with probabilities, order and significance by the calibration of this program; nothing is fitted.
    /// Errors: kInvalidInput: it lacks the evidence.
    Result<std::string> judged_again(const std::string& gap_json);

  private:
    std::unique_ptr<Session> session_;
    GapDiagnosis* diagnosis_ = nullptr;
};

}  // namespace teres::tools
