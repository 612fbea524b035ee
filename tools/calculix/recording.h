// A recording simulated by CalculiX: quadratic tetrahedra and wedges in parts, loads and supports that follow curves of
// time, springs to the ground, static (with creep if a material has it) or dynamic; displacements at given times.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/calculix/solver.h"

namespace teres::calculix {

/// Piecewise linear in time; the first time must be 0.
struct Curve {
    std::vector<double> t_s, value;
};

struct Part {
    enum class Element { kTet10, kWedge15 };
    Element element = Element::kTet10;
    std::vector<std::vector<std::int32_t>> elements;  ///< node ids in CalculiX's order
    CalculixMaterial material;
};

/// force of a node = pattern x value of the curve
struct NodalLoad {
    std::vector<std::pair<std::int32_t, Point>> pattern;
    Curve curve;
};

/// Follower pressure [Pa] on faces of tetrahedra: (part, element of the part, face 1..4).
struct FacePressure {
    std::vector<std::array<std::int32_t, 3>> faces;
    Curve curve;
};

struct BodyForce {
    Point direction{};  ///< unit
    Curve curve;        ///< [m/s^2]
};

/// Nodes held (value 0 without a curve) or moved along an axis.
struct Support {
    std::vector<std::int32_t> nodes;
    int axis = 0;
    std::optional<Curve> curve_m;
};

/// Linear spring of one axis to the ground.
struct GroundSpring {
    std::int32_t node_id = 0;
    std::array<double, 3> stiffness_n_per_m{};
};

/// Spring along the line from a node to a fixed point: force over elongation, tension positive.
struct LineSpring {
    std::int32_t node_id = 0;
    Point anchor_m{};
    std::vector<std::pair<double, double>> elongation_force;  ///< ascending elongation
};

struct CalculixRecording {
    std::vector<Point> nodes;
    std::vector<Part> parts;
    std::vector<Support> supports;
    std::vector<NodalLoad> loads;
    std::vector<FacePressure> pressures;
    std::vector<BodyForce> body_forces;
    std::vector<GroundSpring> ground_springs;
    std::vector<LineSpring> line_springs;
    std::vector<std::pair<std::int32_t, double>> masses_kg;  ///< of nodes, dynamic only
    std::vector<double> times_s;                             ///< ascending, > 0: displacements are wanted here
    std::vector<std::int32_t> output_nodes;
    double max_increment_s = 0.25;
    bool dynamic = false;
    bool large_displacements = true;
    double residual = 2e-2, correction = 0.1;  ///< convergence as in CalculixProblem; Newton is then within micrometres
};

std::string recording_input(const CalculixRecording& recording);

struct RecordingSolution {
    std::vector<std::map<std::int32_t, Point>> displacement_m;  ///< per time, of the output nodes
    double seconds = 0.0;
};

/// Runs in `scratch` (made). Errors: of run_calculix; kNotUsable: a time is missing.
Result<RecordingSolution> solve_recording(const CalculixRecording& recording, const std::filesystem::path& scratch,
                                          double limit_s);

}  // namespace teres::calculix
