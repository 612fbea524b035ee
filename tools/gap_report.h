// The report of a diagnosis: one index.html that needs nothing but a browser (no network, no other file), beside it
// every figure's data as CSV and the figures as PNG.
#pragma once

#include <filesystem>
#include <string>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::tools {

/// `report_json`: "teres-gap-report-1" of the unit `diagnosis`. Makes the folder. Errors: kHostFault on writing.
Status write_gap_report(const std::string& report_json, const TetMeshData& mesh, const SensorData& sensor,
                        const std::filesystem::path& folder);

/// The answer in plain words, two or three sentences.
std::string verdict_text(const std::string& gap_json);

/// The page without its data: "@DATA@" stands where report_json goes, "@VERDICT@" where the verdict goes.
extern const char* const kGapReportPage;

}  // namespace teres::tools
