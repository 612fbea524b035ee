// Settings of the unit `estimator`: default, unit, range and help of each, in one place.
#pragma once

#include <string>

#include "core/plugin_sdk.h"
#include "core/result.h"
#include "plugins/estimator/boundary_estimator.h"

namespace teres {

struct EstimatorSettings {
    std::string filter = "roukf";
    std::string sigma_points = "simplex";
    double sigma_spread = 1.0;
    std::string transform = "log";
    double process_noise_per_sqrt_s = 0.03;
    double forgetting_time_s = 0.0;
    double reinflation = 0.5;
    double reinflation_ratio = 3.0;
    double gate_probability = 0.9999;
    double max_gated_share = 0.5;
    double default_marker_sigma_m = 0.0005;
    double relative_model_error = 0.05;
    double model_error_sigma_m = 0.0003;
    double model_error_correlation_s = 2.0;
    double unresolved_share = 0.75;
    double accepted_residual = 1e-2;
    double stale_after_s = 0.5;
    int max_queue = 1;
    bool keep_recording = false;
    std::string case_folder;
    bool surface = false;
    SurfaceOptions surface_options;

    template <class V>
    void visit(V& field) {
        field("filter", filter, "roukf|ukf",
              "roukf: state and parameters together, reduced order; ukf: parameters only");
        field("sigma_points", sigma_points, "simplex|star",
              "simplex: p+1 simulations a frame; star: 2p+1, third-order exact for symmetric priors");
        field("sigma_spread", sigma_spread, {0.01, 3.0},
              "distance of the sigma points over that of the plain unscented transform");
        field("transform", transform, "log|sigmoid|project|absolute|none",
              "filter coordinates of the parameters; log and sigmoid cannot leave the physical range");
        field("process_noise_per_sqrt_s", process_noise_per_sqrt_s, {0.0, 10.0},
              "random walk of a parameter in one second, in standard deviations of its prior");
        field("forgetting_time_s", forgetting_time_s, {0.0, 1e6},
              "time constant with which old frames lose weight; 0: never");
        field("reinflation", reinflation, {0.0, 10.0},
              "added to a parameter's spread after frames that contradict the filter, in standard deviations "
              "of its prior");
        field("reinflation_ratio", reinflation_ratio, {1.0, 1e6},
              "frames contradict the filter when NIS / degrees of freedom exceeds its long-run level this "
              "many times");
        field("gate_probability", gate_probability, {0.5, 1.0}, "share of good markers that pass the gate; 1: no gate");
        field("max_gated_share", max_gated_share, {0.0, 1.0},
              "with more outliers than this share of the markers none is gated: the model is wrong, not they");
        field("default_marker_sigma_m", default_marker_sigma_m, {1e-6, 0.1},
              "noise per axis [m] of markers whose message states none");
        field("relative_model_error", relative_model_error, {0.0, 1.0},
              "model error of a marker, as a share of its displacement");
        field("model_error_sigma_m", model_error_sigma_m, {0.0, 0.1}, "model error of a marker at rest [m]");
        field("model_error_correlation_s", model_error_correlation_s, {0.0, 1e4},
              "correlation time of the model error: frames closer than this count as one; 0: white");
        field("unresolved_share", unresolved_share, {0.0, 1.0},
              "a ligament holds with some nodes of a group only: spread added to the stated stiffness of an observed "
              "group, as a share of the prior's");
        field("accepted_residual", accepted_residual, {1e-12, 1.0},
              "a simulation that ends with a larger relative residual corrects nothing");
        field("stale_after_s", stale_after_s, {0.01, 3600.0},
              "without markers for so long while loads arrive, the estimate goes on as a prediction marked "
              "stale [s]");
        field("max_queue", max_queue, {1, 1000},
              "marker frames that may wait; beyond it the oldest is dropped and counted");
        field("keep_recording", keep_recording,
              "keep every frame in memory for offline smoothing (teres estimate sets it); memory grows with "
              "time");
        field("surface", surface, "SURFACE_POINTS are observed beside MARKERS");
        field("case", case_folder, "", "surface: case folder (teres-case-1) with the mesh; empty: that of [service]");
        field("surface_gate_m", surface_options.gate_m, {1e-4, 0.5},
              "surface points farther from the prediction are of something else");
        field("surface_correlated_points", surface_options.correlated_points, {1.0, 1e6},
              "so many points of the depth surface count as one: the model's error is alike over neighbours");
    }

    Result<BoundaryEstimatorOptions> options() const;
};

}  // namespace teres
