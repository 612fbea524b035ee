// One folder from its scene.json to the figures of the report.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"

namespace teres::peer {

struct BenchOptions {
    bool own = false;       ///< our own filter too
    bool own_only = false;  ///< nothing but our own filter
    bool verbose = false;
    int max_rows = 0;  ///< 0: all compared rows
    std::size_t threads = 0;
};

struct FinalValue {
    std::string name;
    double mean = 0.0, stdev = 0.0, truth = 0.0;
};

/// Our own filter (estimator plugin's code, its defaults) on the same observations.
struct OwnReport {
    std::vector<FinalValue> final;       ///< the folder's parameters; what else was estimated stands behind them
    std::vector<double> sigma_distance;  ///< |mean - truth| / stdev of the folder's parameters, physical
    std::vector<int> refused_points;     ///< observed points that extrapolate beyond the bound
    struct Release {
        std::string name;
        double threshold = 0.0;                           ///< a tenth of the value before the event
        std::optional<double> own_delay_s, peer_delay_s;  ///< from the event until below it
    };
    std::vector<Release> releases;
    double smallest_stdev = 0.0;               ///< over all rows and parameters, physical units
    double own_error = 0.0, peer_error = 0.0;  ///< mean of |mean - truth| / prior of the last row
    double seconds = 0.0;
};

struct FolderReport {
    std::string folder;
    double max_relative_difference = 0.0;
    int rows = 0;
    int worst_row = 0;
    std::string worst_parameter;
    std::vector<FinalValue> final;
    std::vector<double> tenths;  ///< largest relative difference of each tenth of the rows
    bool reached = true;         ///< within 1e-3 on every row
    bool compared = true;
    double seconds = 0.0, generator_seconds = 0.0;
    std::vector<std::string> warnings;
    std::optional<OwnReport> own;
};

inline constexpr double kBound = 1e-3;

Result<FolderReport> run_folder(const std::filesystem::path& folder, const BenchOptions& options);
std::string table_of(const FolderReport& report, bool verbose);
nlohmann::ordered_json json_of(const FolderReport& report);

}  // namespace teres::peer
