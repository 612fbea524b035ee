// How far predicted positions are from the truth: errors over all frames and points, and what is missing.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::tools {

struct FrameError {
    double t_s = 0.0;
    std::size_t num_points = 0;
    double mean_mm = 0.0, max_mm = 0.0;
};

/// Errors are distances [mm]; each true position counts once, whatever its frame.
struct Score {
    std::size_t num_positions = 0;  ///< true positions that were predicted
    std::size_t num_points = 0;     ///< different point ids of the truth
    double mean_mm = 0.0, rms_mm = 0.0, median_mm = 0.0, p95_mm = 0.0, max_mm = 0.0;
    double max_t_s = 0.0;  ///< where max_mm is
    std::int32_t max_point_id = 0;
    std::vector<FrameError> frames;
    std::size_t worst_frame = 0;       ///< index into frames: largest mean
    std::size_t num_ignored = 0;       ///< predicted rows at times that the truth does not have
    std::size_t num_missing = 0;       ///< true positions without a finite prediction
    std::vector<std::string> missing;  ///< the first of them, as text
};

/// Frames match when their times differ by less than a quarter of the shortest frame, at most 1 ms. True
/// positions that are NaN are left out. Errors (kInvalidInput): no truth, a point id that the truth does not
/// have, a position predicted twice.
Result<Score> score_prediction(std::span<const PositionSample> truth, std::span<const PositionSample> prediction);

}  // namespace teres::tools
