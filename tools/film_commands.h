// The verbs around films: what cameras saw and what was found in it. See tools/commands.h.
#pragma once

#include "tools/commands.h"

namespace teres::tools {

void add_phantom_command(CLI::App& app, int& exit_code);
void add_film_score_command(CLI::App& app, int& exit_code);

}  // namespace teres::tools
