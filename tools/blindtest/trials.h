// The two later stages of a blind test: `teres diagnose` on every case folder, then labels opened and compared.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "core/result.h"
#include "tools/blindtest/plan.h"
#include "tools/blindtest/scoring.h"

namespace teres::blindtest {

struct TrialOptions {
    std::filesystem::path out;      ///< of the generator
    std::filesystem::path program;  ///< teres
    bool withheld = false;    ///< once more with the true effect excluded (the only use of a label before scoring)
    double limit_s = 1800.0;  ///< of one diagnosis
};

/// Writes answers/<case>.json, .csv and .nominal.csv (points predicted with and without the named effects), .cost.json;
/// what is there already is kept. Errors: kHostFault if the program cannot be started.
Status diagnose_case(const CaseSpec& spec, const TrialOptions& options);

/// Whether a case was diagnosed (also if that failed) or discarded by the generator: nothing is left to wait for.
bool ready_to_score(const CaseSpec& spec, const std::filesystem::path& out);
/// An answer (teres-gap-1) as it is to be scored.
using AnswerChange = std::function<Result<std::string>(const std::string& gap_json)>;
/// Opens the label. nullopt: the case was discarded by the generator. Errors: sealed files missing or malformed, or
/// `change` (of every answer, where it is given) fails.
Result<std::optional<CaseResult>> score_case(const CaseSpec& spec, const std::filesystem::path& out,
                                             const AnswerChange& change = {});

}  // namespace teres::blindtest
