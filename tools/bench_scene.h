// The scene of `teres bench`: a liver-sized body of our own shape that hangs on a ligament, pulled at both
// lobes.
//
// A lattice of cubes (six tetrahedra each) is mapped onto a flattened ball with a thick right and a thin left
// side; the ligament runs as a strip over the top, the vena cava holds a patch at the back. Loads are
// periodic and never constant, frames come at 30 Hz.
#pragma once

#include "core/case/case.h"

namespace teres::tools {

struct BenchScene {
    int tetrahedra = 7500;  ///< about
    BodyLaw law = BodyLaw::kStVK;
    double youngs_modulus_pa = 21.5e3;
    double poissons_ratio = 0.49;
    LigamentLaw ligament = LigamentLaw::kCubicSpring;
    double peak_force_n = 1.5;
    int frames = 150;
    double rate_hz = 30.0;
    int markers = 14;
};

/// The case without observations.
Case bench_case(const BenchScene& scene);

}  // namespace teres::tools
