// The same body in another size, of the same material. Statics of a hyperelastic body is alike at all sizes s: strains
// and stresses stay, so lengths and displacements go with s, forces with s²; body forces must go with 1/s (gravity x
// density).
#pragma once

#include <filesystem>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::phantom {

/// Writes `c` (of scale 1, with its observations) and its validation.csv, scaled about the middle of its box, as a case
/// folder. The camera and gravity stay, the density becomes density / s. Errors: a dynamic case (inertia is not alike),
/// what writing gives.
Status write_scaled_case(const Case& c, double scale, const std::filesystem::path& folder);

}  // namespace teres::phantom
