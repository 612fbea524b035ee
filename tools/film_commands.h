// The verbs around cameras and films: how a camera sees, what it saw, what was found in it, and how it looks augmented.
// See tools/commands.h.
#pragma once

#include "tools/commands.h"

namespace teres::tools {

void add_calibrate_camera_command(CLI::App& app, int& exit_code);
void add_register_command(CLI::App& app, int& exit_code);
void add_phantom_command(CLI::App& app, int& exit_code);
void add_film_score_command(CLI::App& app, int& exit_code);
void add_overlay_command(CLI::App& app, int& exit_code);

}  // namespace teres::tools
