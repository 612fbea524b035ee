// When the frames of a recording are.
#pragma once

#include <vector>

#include "core/case/case.h"

namespace teres {

/// Times of the observations, else frames and dt of case.json; ascending [s].
inline std::vector<double> frame_times(const Case& c) {
    std::vector<double> times;
    for (const auto& sample : c.observations)
        if (times.empty() || sample.t_s > times.back()) times.push_back(sample.t_s);
    if (times.empty())
        for (int k = 0; k < c.num_frames; ++k) times.push_back(k * c.dt_s);
    return times;
}

}  // namespace teres
