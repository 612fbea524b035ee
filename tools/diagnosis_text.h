// Answers of a diagnosis for the terminal.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace teres::tools {

/// What a cause of a teres-gap-1 cannot be told from: "registration, depth_scale with lens_distortion"; "" if nothing.
std::string stand_ins(const nlohmann::ordered_json& cause);

void print_gap(const nlohmann::ordered_json& gap);    ///< teres-gap-1
void print_plan(const nlohmann::ordered_json& plan);  ///< teres-plan-1

}  // namespace teres::tools
