// The program CalculiX (ccx, Debian package calculix-ccx): materials, a run, and what it prints.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::calculix {

/// CalculiX's parametrisations (isochoric stretches l', invariant I1'; G, K from E and nu):
///   kLinear      *ELASTIC; with large displacements S = lambda tr(E) I + 2 mu E (Saint Venant-Kirchhoff)
///   kNeoHookean  W = G/2 (I1' - 3) + K/2 (J - 1)^2                                         [J/m^3]
///   kYeoh        W = G/2 (I1' - 3) + yeoh_c20_pa (I1' - 3)^2 + yeoh_c30_pa (I1' - 3)^3 + K/2 (J - 1)^2
///   kOgden       W = 2 G/alpha^2 (l1'^alpha + l2'^alpha + l3'^alpha - 3) + K/2 (J - 1)^2
struct CalculixMaterial {
    enum class Law { kLinear, kNeoHookean, kYeoh, kOgden };
    Law law = Law::kLinear;
    double youngs_modulus_pa = 0.0;
    double poissons_ratio = 0.0;
    double alpha = 1.0;                           ///< Ogden only
    double yeoh_c20_pa = 0.0, yeoh_c30_pa = 0.0;  ///< Yeoh only
    double density_kg_m3 = 0.0;                   ///< needed with gravity and inertia
    double creep_per_pa_s = 0.0;  ///< kLinear only, > 0: deviatoric creep rate = creep * Mises stress (*VISCO step)

    double shear_modulus_pa() const { return youngs_modulus_pa / (2.0 * (1.0 + poissons_ratio)); }
    double bulk_modulus_pa() const { return youngs_modulus_pa / (3.0 * (1.0 - 2.0 * poissons_ratio)); }
};

/// *MATERIAL and *SOLID SECTION of the elements `set`.
std::string material_card(const CalculixMaterial& material, const std::string& name, const std::string& set);

/// %.12g
std::string number(double value);

/// True if ccx can be started.
bool calculix_available();

struct CalculixRun {
    double seconds = 0.0;
    std::string dat;  ///< text of <job>.dat
};

/// Runs <folder>/<job>.inp. Errors: kHostFault: ccx missing; kNotUsable: it failed or took more than `limit_s` of
/// processor time (with its last words).
Result<CalculixRun> run_calculix(const std::filesystem::path& folder, const std::string& job, int threads,
                                 double limit_s);

/// One printed table of a .dat file: rows "id v1 v2 v3"; ids 0-based.
struct CalculixBlock {
    double time = 0.0;
    std::map<std::int32_t, Point> rows;
};

/// Every block whose title starts with `title` ("displacements", "forces"), in order.
/// Fortran's 1.0-101 (a three-digit exponent without its E) is read as 1.0e-101.
Result<std::vector<CalculixBlock>> read_blocks(const std::string& dat, const std::string& title);
/// Rows of the last of them. Errors (kNotUsable): there is none.
Result<std::map<std::int32_t, Point>> last_block(const std::string& dat, const std::string& title);

}  // namespace teres::calculix
