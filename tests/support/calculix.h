// Independent truth for the mechanics: one static equilibrium by CalculiX (program ccx) on the same
// tetrahedra. The tetrahedra become straight-sided ten-node ones (C3D10) by mid-edge nodes, or stay linear
// (C3D4).
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::test {

/// CalculiX's parametrisations:
///   kLinear      *ELASTIC; with large displacements S = lambda tr(E) I + 2 mu E (Saint Venant-Kirchhoff)
///   kNeoHookean  W = mu/2 (I1' - 3) + K/2 (J - 1)^2,  I1' of isochoric stretches        [J/m^3]
///   kOgden       W = 2 G/alpha^2 (l1'^alpha + l2'^alpha + l3'^alpha - 3) + K/2 (J - 1)^2
struct CalculixMaterial {
    enum class Law { kLinear, kNeoHookean, kOgden };
    Law law = Law::kLinear;
    double youngs_modulus_pa = 0.0;
    double poissons_ratio = 0.0;
    double alpha = 1.0;          ///< Ogden only
    double density_kg_m3 = 0.0;  ///< needed with gravity

    double shear_modulus_pa() const { return youngs_modulus_pa / (2.0 * (1.0 + poissons_ratio)); }
    double bulk_modulus_pa() const { return youngs_modulus_pa / (3.0 * (1.0 - 2.0 * poissons_ratio)); }
};

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

/// True if ccx can be started.
bool calculix_available();

/// Text of the .inp file. Errors (kInvalidInput): an id out of range, gravity without density, material out
/// of range.
Result<std::string> calculix_input(const CalculixProblem& problem);

/// Writes, runs ccx at low priority in `scratch` (a folder that exists) and reads the displacements of the
/// last increment. Errors: of calculix_input; kHostFault: ccx missing; kNotUsable: ccx failed or did not
/// reach full load (with its text).
Result<CalculixSolution> solve_with_calculix(const CalculixProblem& problem,
                                             const std::filesystem::path& scratch);

/// Rows "id v1 v2 v3" of the last block of a .dat file whose title starts with `title`; ids 0-based.
/// Fortran's 1.0-101 (a three-digit exponent without its E) is read as 1.0e-101.
Result<std::map<std::int32_t, Point>> last_block(const std::string& dat, const std::string& title);

}  // namespace teres::test

/// Skips loudly when ccx is not installed.
#define TERES_REQUIRE_CALCULIX()            \
    if (!teres::test::calculix_available()) \
    GTEST_SKIP() << "SKIPPED LOUDLY: program 'ccx' not found; apt-get install calculix-ccx"
