// A shaded picture of the body's surface from two directions, coloured by a value per node (attachment
// probability).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::tools {

/// Orthographic view. Both directions are in the frame of the mesh and need not be unit vectors.
struct View {
    std::string name;
    Point from{0.0, 0.0, 1.0};  ///< from the body towards the eye
    Point up{0.0, 1.0, 0.0};
};

struct LiverPicture {
    std::string title{};
    std::string value_name = "attachment probability";
    std::vector<double> value{};                ///< one per node of the mesh, 0..1; NaN: grey
    std::vector<std::int32_t> outline_nodes{};  ///< true attachment: its border is drawn; empty: none
    std::string outline_name = "true attachment";
    std::vector<Point> dots{};  ///< e.g. markers [m]
    std::string dots_name = "marker";
    std::vector<View> views{};  ///< empty: default_views
    int width_px = 1600;
    int height_px = 860;
};

/// The camera's view if the case has one (else from +z, up +y), and one that faces the nodes of high value.
std::vector<View> default_views(const TetMeshData& mesh, const SensorData& sensor, const std::vector<double>& value);

/// PNG. Errors: kInvalidInput if a size does not match the mesh or a view has no direction, kHostFault on
/// writing.
Status save_liver_picture(const LiverPicture& picture, const TetMeshData& mesh, const std::filesystem::path& file);

}  // namespace teres::tools
