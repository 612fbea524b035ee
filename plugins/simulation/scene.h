// The mechanical system of one frame as effects see and change it. Before every frame it is nominal again;
// the effects of a hypothesis then act on it in the order of the catalogue.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "core/case/case.h"
#include "core/case/surface.h"
#include "plugins/simulation/case_model.h"
#include "plugins/simulation/obstacles.h"
#include "plugins/simulation/viscous_memory.h"

namespace teres {

/// Which tethers of the system are what.
struct TetherRanges {
    std::size_t ligament_end = 0;  ///< [0, ligament_end): prior ligament
    std::size_t clamp_begin = 0;   ///< [clamp_begin, clamp_end): layer that holds the clamped nodes
    std::size_t clamp_end = 0;
};

/// Part of the surface, shared by its nodes.
struct Patch {
    std::vector<NodeIndex> node;
    std::vector<double> area_m2;
    double total_m2 = 0.0;
};

class Scene {
  public:
    /// Keeps references to both. clamp_layer_m: thickness of the layer that stands for rigid clamps.
    Scene(const Case& c, CaseModel& model, const TetherRanges& tethers, double clamp_layer_m);

    // What a case is, for effects to look at.
    const Case& data;
    const TetMesh& mesh;
    Surface surface;
    TetherRanges tethers;
    double clamp_layer_m;
    bool dynamic;
    double start_s = 0.0, end_s = 0.0;  ///< of the recording
    double youngs_modulus_pa = 0.0, size_m = 0.0, mass_kg = 0.0;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    std::vector<Eigen::Matrix3Xd> point_centre;  ///< per strain point set: where its points are at rest

    // What effects may change: gravity and node masses of `parts`, and
    std::vector<StrainPoints>& body_points() {  ///< stiffness_scale, stiffening
        body_touched = true;
        return parts.body.points();
    }
    std::vector<Tether>& ties() {
        ties_touched = true;
        return parts.tethers;
    }
    bool body_touched = true, ties_touched = true;  ///< since the last reset
    double t_s = 0.0;
    MechanicalSystem::Parts& parts;
    std::vector<double> region_force_n;  ///< 3 per load region
    Eigen::Matrix3Xd force_n;            ///< further dead load per node
    Eigen::VectorXd pressure_pa;         ///< per surface triangle, follows it, positive pushes inwards
    Obstacles obstacles;
    std::vector<ViscousBranch> viscosity;
    double rayleigh_mass_1_s = 0.0;
    /// By the bits of centre and radius, what surface_patch() made: a motion asks for the same at every step.
    std::map<std::array<std::uint64_t, 4>, Patch> patches;

    /// Nominal again, at time t under these forces of the load regions.
    void reset(double t_s, const std::vector<double>& region_force_n);
    bool has_pressure() const { return (pressure_pa.array() != 0.0).any(); }
    /// Nodal forces of pressure_pa on the surface deformed to x (3N, x-y-z per node), added to f.
    void add_pressure_force(const double* x, double* f) const;

  private:
    struct Nominal {
        std::vector<std::vector<double>> scale;
        std::vector<Tether> tethers;
        Eigen::VectorXd node_mass_kg;
        Eigen::Vector3d gravity_m_s2;
    } nominal_;
};

}  // namespace teres
