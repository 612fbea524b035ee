// A case folder (format teres-case-1) in memory: body, prior ligament, loads, markers, observations. SI
// units. Plain data; case_reader.h fills and checks it. Node ids are 0-based and follow mesh.vtk.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace teres {

using Point = std::array<double, 3>;  ///< x, y, z [m] (or a force [N])

/// Tetrahedra of mesh.vtk; a tetrahedron with nodes a,b,c,d has det[b-a, c-a, d-a] > 0 after reading.
struct TetMeshData {
    std::vector<Point> nodes;                       ///< rest positions [m]
    std::vector<std::array<std::int32_t, 4>> tets;  ///< node indices
    std::vector<std::int32_t> region;               ///< cell scalar `region`, empty if absent
};

enum class BodyLaw { kStVK, kCorotational, kOgden, kNeoHookean };

/// What the modeller believes of the body.
struct BodyData {
    BodyLaw law = BodyLaw::kStVK;
    double youngs_modulus_pa = 0.0;  ///< E of the small-strain behaviour (derived for Ogden when absent)
    double poissons_ratio = 0.0;     ///< nu of the small-strain behaviour (derived for Ogden when absent)
    double shear_modulus_pa = 0.0;   ///< Ogden G
    double alpha = 0.0;              ///< Ogden exponent
    double bulk_modulus_pa = 0.0;    ///< Ogden K
    double density_kg_m3 = 0.0;
    double rayleigh_mass_1_s = 0.0;
    double rayleigh_stiffness_s = 0.0;
};

enum class LigamentLaw { kNeoHookean, kCubicSpring };

/// What the modeller believes of the ligament: extruded along the outward normal, far edge fixed.
struct LigamentData {
    LigamentLaw law = LigamentLaw::kNeoHookean;
    double youngs_modulus_pa = 0.0;
    double poissons_ratio = 0.0;
    double height_m = 0.0;     ///< along the normal
    double width_m = 0.0;      ///< of the strip on the surface; 0 if not given
    double thickness_m = 0.0;  ///< of a sheet; 0 if not given
};

struct NodeProbability {
    std::int32_t node_id = 0;
    double probability = 0.0;  ///< in [0, 1]
};

/// A named load: the total force on `region` is spread over nodes with weights that sum to 1.
struct LoadRegion {
    std::string name;
    std::vector<std::int32_t> node_ids;
    std::vector<double> weights;
};

struct LoadSample {
    double t_s = 0.0;
    std::int32_t region = 0;  ///< index into load_regions
    Point force_n{};
};

/// A node tied by a linear spring to a moving point.
struct ToolTie {
    std::string name;
    std::int32_t node_id = 0;
    double stiffness_n_per_m = 0.0;
};

struct ToolSample {
    double t_s = 0.0;
    std::int32_t tool = 0;  ///< index into tools
    Point position_m{};     ///< NaN: detached
};

enum class SpringLaw {
    kLinear,      ///< tension k1 (l - l0), pushes and pulls
    kRestShape,   ///< f = -k1 (x - anchor), all directions, zero length
    kCubic,       ///< tension only, f = k1 d^3 + k2 d^2 + k3 d, d = l - l0 [m]
    kPolynomial,  ///< tension only, f = k1 e + k2 e^2 + k3 e^3, e = (l - l0)/l0
};

struct SpringData {
    std::int32_t node_id = 0;
    Point anchor_m{};
    SpringLaw law = SpringLaw::kLinear;
    std::array<double, 3> k{};  ///< k1, k2, k3 in the units of the law
    double rest_length_m = 0.0;
    std::string group;  ///< springs of one group share a stiffness factor
};

struct MarkerRest {
    std::int32_t id = 0;
    Point position_m{};
};

/// One observed (or true) position; NaN coordinates mark a lost marker.
struct PositionSample {
    double t_s = 0.0;
    std::int32_t id = 0;
    Point position_m{};
};

struct SensorData {
    double noise_sigma_m = 0.0;  ///< per axis
    std::optional<Point> camera_position_m;
    std::optional<Point> view_direction;
    std::optional<Point> up;
    double latency_s = 0.0;
};

struct Case {
    std::filesystem::path folder;
    std::string name;
    std::string frame;
    int num_frames = 0;
    double dt_s = 0.0;
    bool quasi_static = true;
    BodyData body;
    std::optional<LigamentData> ligament;
    Point gravity_m_s2{};
    SensorData sensor;
    std::string stream;  ///< LCM log beside case.json that replaces observations.csv; empty if none

    TetMeshData mesh;
    std::vector<std::int32_t> clamped;
    std::vector<NodeProbability> ligament_prior;
    std::vector<LoadRegion> load_regions;
    std::vector<LoadSample> loads;  ///< sorted by time
    std::vector<ToolTie> tools;
    std::vector<ToolSample> tool_samples;  ///< sorted by time
    std::vector<SpringData> springs;
    std::vector<MarkerRest> markers;
    std::vector<PositionSample> observations;  ///< sorted by time; ids are marker ids
    std::vector<MarkerRest> validation_rest;   ///< points to predict (ids are point ids)
};

}  // namespace teres
