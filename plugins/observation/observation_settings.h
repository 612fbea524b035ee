// Settings of the unit `observation`: default, unit, range and help of each, in one place.
#pragma once

#include <filesystem>
#include <string>

#include "core/plugin_sdk.h"
#include "plugins/observation/lift.h"
#include "plugins/observation/marker_tracker.h"
#include "plugins/observation/rigid_registration.h"
#include "plugins/observation/texture_tracker.h"

namespace teres {

struct ObservationSettings {
    std::string case_folder;
    std::string source = "depth";
    std::string features = "markers";
    std::string markers = "dark";
    TextureOptions texture;
    TrackerOptions tracker;
    LiftOptions lift;
    std::string registration = "stated";
    std::filesystem::path landmarks;
    RegistrationOptions refine{.stride_px = 6};
    double registration_lost_s = 5.0;
    int surface_points = 0;
    double surface_gate_m = 0.01;
    double pair_tolerance_s = 0.016;
    double publish_period_s = 0.0;
    double sigma_factor = 1.0;

    template <class V>
    void visit(V& field) {
        field("case", case_folder, "",
              "case folder (teres-case-1): markers at rest, camera pose; empty: that of [service]");
        field("source", source, "depth|stereo",
              "depth: CAMERA_COLOR and CAMERA_DEPTH; stereo: CAMERA_LEFT and CAMERA_RIGHT");
        field("features", features, "markers|texture",
              "what is tracked: painted dots, or corners of the liver's own texture, chosen in the first frame (the "
              "liver at rest; SURFACE_POINTS)");
        field("texture_features", texture.features, {8, 1000}, "texture: at most so many");
        field("texture_spacing_m", texture.spacing_m, {1e-4, 0.5}, "texture: least distance of two features");
        field("markers", markers, "dark|bright", "dots against what surrounds them");
        field("marker_diameter_m", tracker.diameter_m, {1e-4, 0.1}, "of the dots");
        field("marker_contrast", tracker.contrast, {1.01, 100.0},
              "least brightness ratio between dot and surroundings");
        field("start_gate_m", tracker.start_gate_m, {1e-4, 0.5}, "search radius about the rest positions at the start");
        field("find_gate_m", tracker.find_gate_m, {1e-4, 0.5},
              "search radius about where neighbours say that a lost marker is");
        field("consistency_limit_m", tracker.consistency_limit_m, {1e-4, 0.5},
              "a marker that moves so far against its neighbours is rejected");
        field("neighbour_reach_m", tracker.neighbour_reach_m, {1e-3, 1.0},
              "length over which neighbours predict a marker");
        field("max_flow_error_px", tracker.max_flow_error_px, {0.01, 20.0},
              "optical flow forward and back: largest difference");
        field("min_area_ratio", tracker.min_area_ratio, {0.0, 1.0},
              "a dot with less of its area in view is partly hidden");
        field("pixel_sigma", lift.pixel_sigma, {0.001, 10.0}, "noise of a dot's centre [px]");
        field("depth_noise_per_m", lift.depth_noise_per_m, {0.0, 1.0},
              "noise of a depth pixel: this times z squared [1/m]");
        field("depth_window_m", lift.window_radius_m, {1e-4, 0.1}, "radius of the patch whose depth is used");
        field("min_valid_share", lift.min_valid_share, {0.0, 1.0}, "of the patch with depth; less is a hole");
        field("max_spread_m", lift.max_spread_m, {1e-5, 0.1}, "depth left about the patch's plane; more is an edge");
        field("registration", registration, "stated|surface",
              "pose of the camera to the model: as stream or case state it; surface: that, then refined on dots and "
              "depth surface "
              "at the start and whenever the markers are lost (REGISTRATION; the liver at rest)");
        field("landmarks", landmarks,
              "surface: start from where these are seen (landmark,x_m,y_m,z_m,u_px,v_px: model at rest, tracking "
              "camera's image at the start), "
              "not from the stated pose; empty: none");
        field("registration_gate_m", refine.start_gate_m, {1e-3, 0.5},
              "surface: points farther from the model at the start are not of the liver");
        field("registration_max_rms_m", refine.max_rms_m, {1e-4, 0.1},
              "surface: refused if the points stay farther from the model");
        field("registration_lost_s", registration_lost_s, {0.0, 3600.0},
              "surface: found anew after so long without a marker; 0: never");
        field("surface_points", surface_points, {0, 5000},
              "about so many points of the liver's depth surface in SURFACE_POINTS; 0: none");
        field("surface_gate_m", surface_gate_m, {1e-4, 0.5},
              "depth farther from the liver's newest prediction is not of the liver");
        field("pair_tolerance_s", pair_tolerance_s, {0.0, 1.0}, "two cameras' frames belong together within this");
        field("publish_period_s", publish_period_s, {0.0, 60.0}, "least time between MARKERS; 0: every frame");
        field("sigma_factor", sigma_factor, {0.01, 100.0}, "on the stated standard deviations");
    }
};

}  // namespace teres
