// The main job offline: a recording through replay driver, estimator and forward model (the same units as the
// service), then what the whole recording says about every frame (smoothing) and the body's motion under it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/config.h"
#include "core/extensions/forward_model.h"
#include "core/result.h"

namespace teres::tools {

/// Known actions and observations of one frame, in the order of the forward model's regions, tools and
/// markers.
struct RecordedFrame {
    double t_s = 0.0;
    std::vector<double> force_n, tool_m;  ///< 3 per region; 3 per tool
    std::vector<double> marker_m;         ///< 3 per marker; NaN: lost
};

struct EstimatedFrame {
    std::vector<double> mean, stdev;  ///< physical, after this frame
    std::vector<double> smoothed;     ///< physical, from the whole recording
    double nis = 0.0;
    int degrees_of_freedom = 0;
    bool stale = false;
    bool converged = true;
};

struct ParameterSummary {
    std::string name, unit;
    double mean = 0.0, stdev = 0.0, observability = 0.0, prior_median = 0.0;
};

/// Motion of the body over the recording under given parameters.
struct Motion {
    double marker_rms_m = 0.0;                ///< observed minus model, over all seen markers (3-D distance)
    std::vector<std::vector<double>> points;  ///< per frame, 3 per validation point [m]
    std::vector<std::vector<double>> body;    ///< per frame, 3 per mesh node [m]; only if asked for
    std::size_t frames_not_converged = 0;
};

struct Estimation {
    std::vector<RecordedFrame> recording;
    std::vector<EstimatedFrame> frames;
    std::vector<ParameterSummary> parameters;
    std::vector<std::int32_t> attachment_node, point_id;
    std::vector<double> attachment_probability;  ///< per attachment_node
    Motion prior, fixed, estimated;
    bool has_fixed = false;          ///< the case has an atlas region that can be held
    double seconds_per_frame = 0.0;  ///< of the filter
};

struct EstimationOptions {
    bool estimate = true;    ///< false: only the motion with the atlas region held fixed
    bool keep_body = false;  ///< fill Motion::body
    int passes = 0;          ///< further passes of the smoother over the recording
    std::function<void(const char* stage, std::size_t done, std::size_t total)> progress{};
};

/// `config`: settings of the units; drivers, plugins, bus, case and speed are set here.
/// Errors: bad case or settings; kNotUsable if there is nothing to estimate or hold.
Result<Estimation> estimate_case(const std::string& case_folder, Config config, const EstimationOptions& options);

}  // namespace teres::tools
