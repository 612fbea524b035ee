// Landmarks of the model (ends of the falciform, the ridge, vessels, markers) and where they are seen in the tracking
// camera's image.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/camera/camera_model.h"
#include "core/case/case.h"
#include "core/result.h"
#include "plugins/observation/lift.h"

namespace teres {

struct Landmark {
    std::string name;
    Point model;  ///< on the model at rest, case axes [m]
    Pixel pixel;
};

/// `landmark,x_m,y_m,z_m,u_px,v_px`. Errors: malformed, fewer than three.
Result<std::vector<Landmark>> read_landmarks(const std::filesystem::path& file);

/// Pose of the tracking camera (camera -> case), and the names of landmarks without depth, which are left out.
struct LandmarkPose {
    Pose camera_to_case;
    std::vector<std::string> left_out;
};
/// [loop] guess_z_m: about how far they are. Errors: fewer than three have depth, or all lie on one line.
Result<LandmarkPose> pose_from_landmarks(std::span<const Landmark> landmarks, const Lift& lift, double guess_z_m);

}  // namespace teres
