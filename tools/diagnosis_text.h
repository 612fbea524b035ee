// Answers of a diagnosis for the terminal.
#pragma once

#include <nlohmann/json.hpp>

namespace teres::tools {

void print_gap(const nlohmann::ordered_json& gap);    ///< teres-gap-1
void print_plan(const nlohmann::ordered_json& plan);  ///< teres-plan-1

}  // namespace teres::tools
