// Independent truth for the mechanics: one static equilibrium by CalculiX (program ccx) on the same
// tetrahedra. The tetrahedra become straight-sided ten-node ones (C3D10) by mid-edge nodes, or stay linear
// (C3D4).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"
#include "tools/calculix/solver.h"

namespace teres::calculix {

/// Uniform dead traction on a face given by three corner nodes; total force = traction x rest area.
struct FaceTraction {
    std::array<std::int32_t, 3> face{};
    Point traction_pa{};
};

struct NodeForce {
    std::int32_t node_id = 0;  ///< corner node
    Point force_n{};
};

/// One displacement component of a corner node held at zero (a mid-edge node between two of them too).
struct Roller {
    std::int32_t node_id = 0;
    int axis = 0;
};

struct CalculixProblem {
    std::vector<Point> nodes;                       ///< corner nodes [m]
    std::vector<std::array<std::int32_t, 4>> tets;  ///< positive orientation
    CalculixMaterial material;
    std::vector<std::int32_t> clamped;  ///< corner nodes; a mid-edge node between two of them is held too
    std::vector<Roller> rollers;
    std::vector<NodeForce> node_forces;
    std::vector<FaceTraction> face_tractions;
    Point gravity_m_s2{};
    bool quadratic = true;            ///< C3D10, else C3D4
    bool large_displacements = true;  ///< NLGEOM
    int increments = 1;               ///< equal load increments (ccx cuts them when it must)
    double residual = 1e-6;           ///< an increment converged: largest residual over the mean force ...
    double correction = 1e-5;         ///< ... and last correction over the increment's largest displacement
    int threads = 2;
};

struct CalculixSolution {
    std::vector<Point> displacement_m;  ///< of the corner nodes, at full load
    Point reaction_n{};                 ///< total over the held nodes
    std::size_t num_nodes = 0;          ///< with mid-edge nodes
    double seconds = 0.0;
};

/// Text of the .inp file. Errors (kInvalidInput): an id out of range, gravity without density, material out
/// of range.
Result<std::string> calculix_input(const CalculixProblem& problem);

/// Writes, runs ccx at low priority in `scratch` (a folder that exists) and reads the displacements of the
/// last increment. Errors: of calculix_input; kHostFault: ccx missing; kNotUsable: ccx failed or did not
/// reach full load (with its text).
Result<CalculixSolution> solve_with_calculix(const CalculixProblem& problem, const std::filesystem::path& scratch);

}  // namespace teres::calculix
