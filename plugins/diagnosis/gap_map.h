// Where the gap lies: from the parameters of the named cause; when nothing is named, from those of the cause that comes
// nearest if that is first of all a part of the body or a support at a place, else from a map of forces.
//
// Force map: per surface patch and frame, the fictitious force that explains the residual best; frames independent,
// nominal parameters projected out. Right for force-like causes only (a missing stiffness is not a force).
#pragma once

#include <string>

#include "plugins/diagnosis/diagnosis.h"

namespace teres {

/// The simulator's base must be the nominal fit; where nothing is named it may be another afterwards.
Where locate(Simulator& simulator, const Whitener& whitener, const Recording& recording, const Fit& nominal,
             const Verdict& verdict, const Cause* named, bool significant);

/// Place of the first located effect of `named`: the centroid of the forces by which it acts on the body, nearer to the
/// cause than the centre of a ball that only touches the ligament, or of an obstacle. The simulator's last trajectory
/// must be that of `named`. Without such forces the place stays.
void place_by_forces(const Simulator& simulator, const Cause& named, Where& where);

/// What to measure next: separates the first two answers, or makes the suspected one visible.
std::string next_experiment(const EffectTable& effects, const Verdict& verdict, const Confusability& confusability,
                            const Calibration& calibration, bool significant);

}  // namespace teres
