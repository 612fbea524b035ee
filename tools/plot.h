// PNG plots for reports: curves with +-3 sigma bands in one or more panels, and bars.
//
//     Plot plot;
//     plot.title = "Ligament stiffness";
//     plot.x_label = "time [s]";
//     plot.panels.push_back({.title = "r3", .y_label = "N/m", .log_y = true, .curves = {{"estimate", t, mean,
//     sigma}}}); TERES_TRY(save_plot(plot, "stiffness.png"));
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "tools/color.h"

namespace teres::tools {

struct Curve {
    std::string label;             ///< in the legend; empty: not there
    std::vector<double> x, y;      ///< a value that is not finite makes a gap
    std::vector<double> sigma{};   ///< standard deviation of y: draws y +- 3 sigma; empty: none
    std::optional<Color> color{};  ///< default: palette by position
    bool dashed = false;
};

/// A straight line across the panel, e.g. a true value or a bound.
struct ReferenceLine {
    std::string label;
    double y = 0.0;
};

struct Panel {
    std::string title{};
    std::string y_label{};   ///< with the unit in brackets
    bool log_y = false;      ///< values at or below zero are left out
    bool from_zero = false;  ///< the axis starts at 0 (errors)
    std::vector<Curve> curves{};
    std::vector<ReferenceLine> references{};
};

struct Plot {
    std::string title{};
    std::string x_label{};
    std::vector<Panel> panels{};
    int columns = 1;  ///< panels side by side; where all have the same legend it is drawn once
    int width_px = 1600;
    int panel_height_px = 0;  ///< 0: chosen by the number of rows
};

/// Errors: kInvalidInput if there is no panel or x, y, sigma of a curve differ in length; kHostFault on
/// writing.
Status save_plot(const Plot& plot, const std::filesystem::path& file);

struct BarSet {
    std::string label;
    std::vector<double> values;   ///< one per group; not finite: no bar
    std::vector<double> sigma{};  ///< draws whiskers of +- 3 sigma; empty: none
};

struct BarPlot {
    std::string title{};
    std::string y_label{};
    std::vector<std::string> groups{};
    std::vector<BarSet> sets{};
    int width_px = 1600;
    int height_px = 700;
};

Status save_bars(const BarPlot& plot, const std::filesystem::path& file);

}  // namespace teres::tools
