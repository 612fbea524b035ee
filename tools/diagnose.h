// What `teres diagnose` does: a diagnosis of recorded cases, and one of every window that the service alarms about.
#pragma once

#include <string>
#include <vector>

#include "core/bus.h"
#include "core/result.h"
#include "tools/commands.h"
#include "tools/diagnosis_run.h"

namespace teres::tools {

struct DiagnoseOptions {
    std::vector<std::string> cases, excluded;
    std::string json_file, report_folder, predict_file, predict_nominal_file, cache_folder = default_cache_folder();
    bool plan = false;
    int max_effects = 3;
    bool live = false;
    std::string url = kDefaultBusUrl, folder = "gaps";
    double before_s = 15.0, after_s = 5.0;
    SettingsOptions settings;
};

/// Diagnoses options.cases, prints the answer and writes what is asked for. Returns the exit code.
Result<int> diagnose(const DiagnoseOptions& options);

/// Waits for alarms of the service until it is told to stop; each window becomes a case folder with its answer.
int diagnose_live(const DiagnoseOptions& options);

}  // namespace teres::tools
