// A summary as tables (Markdown, as VALIDATION.md holds them) and as pictures.
#pragma once

#include <filesystem>
#include <string>

#include "core/result.h"
#include "tools/blindtest/scoring.h"

namespace teres::blindtest {

std::string report_text(const Summary& summary);
/// confusion.png, reliability.png, effects.png in `folder` (made).
Status save_plots(const Summary& summary, const std::filesystem::path& folder);

}  // namespace teres::blindtest
