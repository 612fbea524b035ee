// What an answer's evidence says with this program's calibration: the fits that it rests on stay as they were made.
#pragma once

#include <string>

#include "core/result.h"
#include "plugins/diagnosis/calibration.h"

namespace teres {

/// `gap_json` (teres-gap-1) with probabilities, their order and `gap.significant` judged again. Where the gap lies and
/// how far it closes are those of what was named then.
/// Errors (kInvalidInput): no teres-gap-1, or without the evidence that judge() asks for.
Result<std::string> judged_again(const std::string& gap_json, const Calibration& calibration);

}  // namespace teres
