// A body that is parted at some time (`cut`): a ball of softened tissue says where and when, faces that open say how
// the parts move. Planes are tried as they are: no derivative leads from one to the next.
#pragma once

#include "plugins/diagnosis/cause_fit.h"
#include "plugins/diagnosis/screening.h"

namespace teres {

/// Where the body is parted, and across what: (x - centre) . normal = 0 within `radius`, entered from the surface along
/// `inwards`, which lies in the plane.
struct CrackPlane {
    Eigen::Vector3d centre_m, inwards, normal;
    double radius_m = 0.0;
};

/// The cut parted across the plane: all of its stiffness is lost there.
ActiveEffect with_crack(const EffectEntry& entry, ActiveEffect cut, const CrackPlane& plane);

/// Planes through these places, entered by the way to the surface and turned about it.
std::vector<CrackPlane> planes_at(const TrajectoryModel& model, const EffectEntry& entry,
                                  const std::vector<Eigen::Vector3d>& places, int turns);

/// Planes near a cut: at its place, at those of the search grid next to it and at those that explain most by first
/// order, turned about the way to the surface.
std::vector<CrackPlane> planes_near(const TrajectoryModel& model, const EffectTable& effects, const ActiveEffect& cut,
                                    std::vector<PlaceGain> by_gain);

/// The same plane moved, tilted, larger and smaller, by `share` of its radius and of a right angle.
std::vector<CrackPlane> planes_beside(const CrackPlane& plane, double share);

/// Where a cut that was fitted alone is not far behind the best, and that leaves more than noise and the model's error,
/// the cut is tried as a crack: what leaves least at a few frames after it is fitted. Static recordings. Whether it
/// was; best score first then.
bool look_for_cracks(Problem& problem, const Fit& nominal, const Screening& screening, std::vector<Cause>& causes);

/// Whether the best, best score first, is a crack that nothing else comes near: then nothing else need be finished.
bool crack_is_far_ahead(const EffectTable& effects, const std::vector<Cause>& by_score);

}  // namespace teres
