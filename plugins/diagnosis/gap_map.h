// Where the gap lies: from the parameters of the named cause, or from maps when nothing is named.
//
// Force map: per surface patch and frame, the fictitious force that explains the residual best; frames independent,
// nominal parameters projected out. Right for force-like causes only (a missing stiffness is not a force).
#pragma once

#include <string>

#include "plugins/diagnosis/diagnosis.h"

namespace teres {

Where locate(Simulator& simulator, const Whitener& whitener, const Recording& recording, const Fit& nominal,
             const Cause* named, bool significant);

/// Place of the first located effect of `named`: the centroid of the forces by which it acts on the body, nearer to the
/// cause than the centre of a ball that only touches the ligament, or of an obstacle. The simulator's last trajectory
/// must be that of `named`. Without such forces the place stays.
void place_by_forces(const Simulator& simulator, const Cause& named, Where& where);

/// What to measure next: separates the first two answers, or makes the suspected one visible.
std::string next_experiment(const EffectTable& effects, const Verdict& verdict, const Confusability& confusability,
                            const Calibration& calibration, bool significant);

}  // namespace teres
