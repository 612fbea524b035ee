// A diagnosis as JSON: the contract "teres-gap-1", the plan, and what the report draws.
#pragma once

#include <string>

#include "plugins/diagnosis/diagnosis.h"

namespace teres {

std::string gap_json(const Diagnosis& diagnosis, const EffectTable& effects, const TrajectoryModel& model,
                     const Calibration& calibration);
std::string plan_json(const Plan& plan, const EffectTable& effects, const Calibration& calibration);
/// gap_json plus mesh, motions and residuals: "teres-gap-report-1".
std::string report_json(const Diagnosis& diagnosis, const EffectTable& effects, const TrajectoryModel& model,
                        const Calibration& calibration);

}  // namespace teres
