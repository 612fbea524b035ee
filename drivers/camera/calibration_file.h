// Calibration of cameras that do not know their own: one file per serial number, config/cameras/<serial>.toml.
#pragma once

#include <filesystem>
#include <optional>

#include "core/result.h"
#include "teres/camera_info_t.hpp"

namespace teres {

/// The camera_info of `folder`/`serial`.toml at the size of the stream (the file may hold another size of the same
/// aspect ratio). Empty if there is no such file. Errors: file, key, bound.
Result<std::optional<camera_info_t>> read_calibration(const std::filesystem::path& folder, const std::string& serial,
                                                      int width_px, int height_px);

}  // namespace teres
