// A small soft liver on a band, pulled at both lobes: the scene of tests that run the filter many times.
#pragma once

#include <vector>

#include "core/extensions/forward_model.h"
#include "tools/bench_scene.h"

namespace teres::test {

inline tools::BenchScene soft_liver(int tetrahedra, int frames) {
    tools::BenchScene s;
    s.tetrahedra = tetrahedra;
    s.youngs_modulus_pa = 10e3;
    s.poissons_ratio = 0.45;
    s.ligament = LigamentLaw::kNeoHookean;
    s.frames = frames;
    s.rate_hz = 5.0;
    s.peak_force_n = 1.0;
    return s;
}

/// Known loads of a frame; `force` holds them.
inline ForwardInputs inputs_at(const Case& c, int frame, std::vector<double>& force) {
    force.clear();
    for (int r = 0; r < 2; ++r)
        for (const double v : c.loads[static_cast<std::size_t>(2 * frame + r)].force_n) force.push_back(v);
    ForwardInputs in;
    in.time_s = frame * c.dt_s;
    in.dt_s = c.dt_s;
    in.region_force_n = force;
    return in;
}

}  // namespace teres::test
