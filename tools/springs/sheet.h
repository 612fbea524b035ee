// A sheet of ligament, clamped at one edge and pulled at the other: the truth that springs are calibrated on.
//
// Uniaxial nominal stress of its material, isochoric, stretch l (neo-Hookean: c2 = c3 = 0; Yeoh, J. Rubber Chem. 1993):
//     P(l) = 2 (l - l^-2) (c1 + 2 c2 (I - 3) + 3 c3 (I - 3)^2),   I = l^2 + 2/l                        [Pa]
// The free edge carries the dead load P(1 + strain) x cross-section, evenly spread, in equal steps from 0.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"
#include "tools/calculix/solver.h"

namespace teres::tools {

struct SheetMaterial {
    std::string name;
    double c1_pa = 0.0, c2_pa = 0.0, c3_pa = 0.0;
    double poissons_ratio = 0.48;
    double youngs_modulus_pa() const { return 4.0 * (1.0 + poissons_ratio) * c1_pa; }  ///< at rest, G = 2 c1
    double stress_pa(double stretch) const;
};

SheetMaterial neo_hookean_sheet(double youngs_modulus_pa, double poissons_ratio);
/// Least squares of c1, c2, c3 on a CSV file `strain,stress_pa` (nominal). Errors (kInvalidInput): fewer than four
/// rows, strain or stress out of range, a fit that does not rise with the strain up to `strain` or misses the curve by
/// more than a tenth of its largest stress.
Result<SheetMaterial> sheet_of_curve(const std::filesystem::path& file, double poissons_ratio, double strain);

struct Sheet {
    double width_m = 0.040, length_m = 0.100, thickness_m = 0.001;  ///< pulled along its length
    double strain = 0.45;
    int cells_per_column = 2;  ///< across the width, between two edge nodes that are compared
    int columns = 5;           ///< edge nodes compared
    int steps = 18;            ///< of the load
    double load_n(const SheetMaterial& m) const { return m.stress_pa(1.0 + strain) * width_m * thickness_m; }
};

struct SheetPath {
    std::vector<double> load_share;        ///< of each step, ascending to 1
    std::vector<Eigen::Matrix3Xd> edge_m;  ///< positions of the edge nodes: x along the length, y across
    double seconds = 0.0;                  ///< of the solver
    std::size_t elements = 0;
};

/// Edge nodes at rest.
Eigen::Matrix3Xd edge_at_rest(const Sheet& sheet);

/// 15-node wedges, one over the thickness, by CalculiX in `scratch`. Errors: of run_calculix.
Result<SheetPath> stretch_sheet(const Sheet& sheet, const SheetMaterial& material, const std::filesystem::path& scratch,
                                double limit_s);

}  // namespace teres::tools
