#include "tools/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/canvas.h"

namespace teres::tools {
namespace {

constexpr double kTextHeight_px = 13.0, kTitleHeight_px = 17.0, kSmall_px = 11.5;

struct Interval {
    double low = std::numeric_limits<double>::infinity();
    double high = -std::numeric_limits<double>::infinity();
    void add(double v) {
        if (!std::isfinite(v)) return;
        low = std::min(low, v);
        high = std::max(high, v);
    }
    bool empty() const { return !(low <= high); }
};

// One axis: value -> pixel, linear or logarithmic.
struct Axis {
    Interval range;
    bool log = false;
    double pixel_low = 0.0, pixel_high = 0.0;
    double map(double v) const {
        const double lo = log ? std::log10(range.low) : range.low, hi = log ? std::log10(range.high) : range.high;
        const double at = log ? (v > 0.0 ? std::log10(v) : -1e3) : v;
        return pixel_low + (at - lo) / (hi - lo) * (pixel_high - pixel_low);
    }
    std::vector<double> ticks(int about) const {
        return log ? log_ticks(range.low, range.high) : round_ticks(range.low, range.high, about);
    }
};

Interval x_range(const Plot& plot) {
    Interval range;
    for (const Panel& panel : plot.panels)
        for (const Curve& curve : panel.curves)
            for (const double x : curve.x) range.add(x);
    if (range.empty()) range = {0.0, 1.0};
    if (range.high == range.low) range.high = range.low + 1.0;
    return range;
}

Interval y_range(const Panel& panel) {
    Interval mean, band;
    for (const Curve& curve : panel.curves)
        for (std::size_t i = 0; i < curve.y.size(); ++i) {
            const double y = curve.y[i];
            if (panel.log_y && y <= 0.0) continue;
            mean.add(y);
            if (curve.sigma.empty()) continue;
            band.add(y + 3.0 * curve.sigma[i]);
            band.add(y - 3.0 * curve.sigma[i]);
        }
    for (const ReferenceLine& line : panel.references)
        if (!panel.log_y || line.y > 0.0) mean.add(line.y);
    if (panel.log_y) {
        if (mean.empty()) return {1.0, 10.0};
        if (!band.empty()) {
            mean.add(std::min(band.high, 100.0 * mean.high));
            // a band that reaches zero goes through the floor of a logarithmic axis
            mean.add(band.low > 0.0 ? band.low : mean.low / 3.0);
        }
        return {mean.low / 1.25, mean.high * 1.25};
    }
    if (mean.empty()) return {0.0, 1.0};
    const double spread = std::max(mean.high - mean.low, 1e-3 * std::max(std::abs(mean.high), std::abs(mean.low)));
    if (!band.empty()) {  // an early band may be huge beside the curve: show at most three times its spread
        mean.add(std::min(band.high, mean.high + 3.0 * spread));
        mean.add(std::max(band.low, mean.low - 3.0 * spread));
    }
    if (panel.from_zero) mean.add(0.0);
    double pad = 0.06 * (mean.high - mean.low);
    if (pad == 0.0) pad = mean.high != 0.0 ? 0.1 * std::abs(mean.high) : 1.0;
    return {panel.from_zero && mean.low == 0.0 ? 0.0 : mean.low - pad, mean.high + pad};
}

double step_of(const std::vector<double>& ticks) {
    return ticks.size() > 1 ? ticks[1] - ticks[0] : 0.0;
}

struct LegendEntry {
    std::string label;
    Color color;
    bool dashed = false, band = false, bar = false;
};

std::vector<LegendEntry> legend_of(const Panel& panel) {
    std::vector<LegendEntry> entries;
    for (std::size_t i = 0; i < panel.curves.size(); ++i) {
        const Curve& curve = panel.curves[i];
        if (curve.label.empty()) continue;
        const bool band = !curve.sigma.empty();
        entries.push_back({curve.label, curve.color.value_or(palette(i)), curve.dashed, band, false});
    }
    for (const ReferenceLine& line : panel.references)
        if (!line.label.empty()) entries.push_back({line.label, kInk, true, false, false});
    return entries;
}

constexpr double kSample_px = 34.0;  // length of a legend's line

void draw_entry(Canvas& canvas, const LegendEntry& entry, double x, double y) {
    const std::array<cv::Point2d, 2> sample{{{x, y}, {x + kSample_px, y}}};
    if (entry.band) canvas.rectangle({x, y - 7.0, kSample_px, 14.0}, entry.color, 0.22);
    if (entry.bar)
        canvas.rectangle({x, y - 7.0, kSample_px, 14.0}, entry.color);
    else
        canvas.polyline(sample, entry.color, 2.4, entry.dashed);
    canvas.text({x + kSample_px + 8.0, y}, entry.label, kSmall_px);
}

// In one line that ends at `right`; returns false when it is wider than `room`.
bool draw_legend_above(Canvas& canvas, const std::vector<LegendEntry>& entries, double right, double y, double room) {
    constexpr double kBetween = 26.0;
    const auto entry_width = [](const LegendEntry& entry) {
        return kSample_px + 8.0 + Canvas::text_width(entry.label, kSmall_px) + kBetween;
    };
    double width = -kBetween;
    for (const LegendEntry& entry : entries) width += entry_width(entry);
    if (width > room) return false;
    double x = right - width;
    for (const LegendEntry& entry : entries) {
        draw_entry(canvas, entry, x, y);
        x += entry_width(entry);
    }
    return true;
}

double legend_width(const std::vector<LegendEntry>& entries) {
    double width = 0.0;
    for (const LegendEntry& entry : entries) width = std::max(width, Canvas::text_width(entry.label, kSmall_px));
    return entries.empty() ? 0.0 : width + 60.0;
}

void draw_legend_beside(Canvas& canvas, const std::vector<LegendEntry>& entries, double x, double y) {
    for (const LegendEntry& entry : entries) {
        draw_entry(canvas, entry, x, y);
        y += 24.0;
    }
}

bool same_legend(const std::vector<Panel>& panels) {
    const auto labels = [](const Panel& panel) {
        std::vector<std::string> out;
        for (const LegendEntry& entry : legend_of(panel)) out.push_back(entry.label);
        return out;
    };
    return std::all_of(panels.begin(), panels.end(), [&](const Panel& p) { return labels(p) == labels(panels[0]); });
}

void draw_axes(Canvas& canvas, cv::Rect2d box, const Axis& x, const Axis& y) {
    const std::vector<double> x_ticks = x.ticks(static_cast<int>(std::max(3.0, box.width / 130.0)));
    const std::vector<double> y_ticks = y.ticks(static_cast<int>(std::max(3.0, box.height / 42.0)));
    for (const double tick : x_ticks) {
        const double at = x.map(tick);
        canvas.line({at, box.y}, {at, box.y + box.height}, kGrid, 1.0);
        canvas.line({at, box.y + box.height}, {at, box.y + box.height + 5.0}, kInk, 1.2);
        canvas.text({at, box.y + box.height + 18.0}, tick_text(tick, step_of(x_ticks)), kSmall_px, Align::kCenter);
    }
    for (const double tick : y_ticks) {
        const double at = y.map(tick);
        canvas.line({box.x, at}, {box.x + box.width, at}, kGrid, 1.0);
        canvas.line({box.x - 5.0, at}, {box.x, at}, kInk, 1.2);
        const double step = y.log ? tick : step_of(y_ticks);
        canvas.text({box.x - 10.0, at}, tick_text(tick, step), kSmall_px, Align::kRight);
    }
}

// Pieces of a curve between gaps, in pixels.
std::vector<std::vector<cv::Point2d>> pieces(const Curve& curve, const Axis& x, const Axis& y, double sigmas) {
    std::vector<std::vector<cv::Point2d>> out(1);
    for (std::size_t i = 0; i < curve.x.size(); ++i) {
        const double value = curve.y[i] + (sigmas == 0.0 ? 0.0 : sigmas * curve.sigma[i]);
        const bool shown = std::isfinite(curve.x[i]) && std::isfinite(value) && (!y.log || curve.y[i] > 0.0);
        if (shown)
            out.back().push_back({x.map(curve.x[i]), y.map(value)});
        else if (!out.back().empty())
            out.emplace_back();
    }
    return out;
}

void draw_curves(Canvas& canvas, const Panel& panel, const cv::Rect2d& box, const Axis& x, const Axis& y) {
    const auto clamp_y = [&](cv::Point2d p) { return cv::Point2d(p.x, std::clamp(p.y, box.y, box.y + box.height)); };
    for (std::size_t i = 0; i < panel.curves.size(); ++i) {
        const Curve& curve = panel.curves[i];
        if (curve.sigma.empty()) continue;
        const auto upper = pieces(curve, x, y, 3.0), lower = pieces(curve, x, y, -3.0);
        for (std::size_t k = 0; k < std::min(upper.size(), lower.size()); ++k) {
            std::vector<cv::Point2d> outline;
            for (const auto& p : upper[k]) outline.push_back(clamp_y(p));
            for (auto p = lower[k].rbegin(); p != lower[k].rend(); ++p) outline.push_back(clamp_y(*p));
            canvas.polygon(outline, curve.color.value_or(palette(i)), 0.20);
        }
    }
    for (const ReferenceLine& line : panel.references) {
        if (y.log && line.y <= 0.0) continue;
        const std::array<cv::Point2d, 2> ends{{{box.x, y.map(line.y)}, {box.x + box.width, y.map(line.y)}}};
        canvas.polyline(ends, kInk, 1.8, true);
    }
    for (std::size_t i = 0; i < panel.curves.size(); ++i) {
        const Curve& curve = panel.curves[i];
        const Color color = curve.color.value_or(palette(i));
        for (auto& piece : pieces(curve, x, y, 0.0)) {
            for (auto& p : piece) p = clamp_y(p);
            if (piece.size() == 1) canvas.dot(piece[0], 3.0, color);
            canvas.polyline(piece, color, 2.4, curve.dashed);
        }
    }
}

// Room left of an axis for its numbers and label.
double left_margin(const Panel& panel) {
    const Axis y{y_range(panel), panel.log_y, 0.0, 1.0};
    const std::vector<double> ticks = y.ticks(6);
    double width = 0.0;
    for (const double tick : ticks)
        width = std::max(width, Canvas::text_width(tick_text(tick, y.log ? tick : step_of(ticks)), kSmall_px));
    return width + (panel.y_label.empty() ? 28.0 : 62.0);
}

void draw_panel(Canvas& canvas, const Panel& panel, cv::Rect2d box, const Interval& x_interval, bool with_legend) {
    const std::vector<LegendEntry> legend = with_legend ? legend_of(panel) : std::vector<LegendEntry>{};
    const double room = box.width - Canvas::text_width(panel.title, kTextHeight_px) - 20.0;
    if (!legend.empty() && !draw_legend_above(canvas, legend, box.x + box.width, box.y - 18.0, room)) {
        const double width = std::min(legend_width(legend), 0.45 * box.width);
        box.width -= width;
        draw_legend_beside(canvas, legend, box.x + box.width + 14.0, box.y + 12.0);
    }
    const Axis x{x_interval, false, box.x, box.x + box.width};
    const Axis y{y_range(panel), panel.log_y, box.y + box.height, box.y};
    draw_axes(canvas, box, x, y);
    draw_curves(canvas, panel, box, x, y);
    canvas.frame(box, kInk, 1.3);
    canvas.text({box.x, box.y - 18.0}, panel.title, kTextHeight_px);
    if (!panel.y_label.empty())
        canvas.vertical_text({box.x - left_margin(panel) + 20.0, box.y + box.height / 2.0}, panel.y_label, kSmall_px);
}

}  // namespace

Status save_plot(const Plot& plot, const std::filesystem::path& file) {
    if (plot.panels.empty()) return invalid_input("plot '" + plot.title + "' has no panel");
    for (const Panel& panel : plot.panels)
        for (const Curve& curve : panel.curves)
            if (curve.x.size() != curve.y.size() || (!curve.sigma.empty() && curve.sigma.size() != curve.y.size()))
                return invalid_input("plot '" + plot.title + "', curve '" + curve.label +
                                     "': " + std::to_string(curve.x.size()) + " x, " + std::to_string(curve.y.size()) +
                                     " y, " + std::to_string(curve.sigma.size()) + " sigma");
    const int columns = std::clamp(plot.columns, 1, static_cast<int>(plot.panels.size()));
    const int rows = (static_cast<int>(plot.panels.size()) + columns - 1) / columns;
    const double panel_height = plot.panel_height_px > 0 ? plot.panel_height_px
                                                         : (rows == 1   ? 520
                                                            : rows == 2 ? 330
                                                                        : 220);
    constexpr double kTop = 56.0, kBottom = 62.0, kRowGap = 74.0, kRight = 30.0;
    const int width = std::max(plot.width_px, 400);
    Canvas canvas(width, static_cast<int>(kTop + rows * (panel_height + kRowGap) + kBottom));
    canvas.text({width / 2.0, 28.0}, plot.title, kTitleHeight_px, Align::kCenter);

    const Interval x_interval = x_range(plot);
    const double beside_title = (width - Canvas::text_width(plot.title, kTitleHeight_px)) / 2.0 - 60.0;
    const bool shared_legend =
        plot.panels.size() > 1 && same_legend(plot.panels) &&
        draw_legend_above(canvas, legend_of(plot.panels[0]), width - kRight - 16.0, 28.0, beside_title);
    double margin = 0.0;  // one for all, so that time lines up between rows
    for (const Panel& panel : plot.panels) margin = std::max(margin, left_margin(panel));
    const double column_width = (width - kRight) / static_cast<double>(columns);
    for (std::size_t i = 0; i < plot.panels.size(); ++i) {
        const int row = static_cast<int>(i) / columns, column = static_cast<int>(i) % columns;
        const bool last_of_column = i + static_cast<std::size_t>(columns) >= plot.panels.size();
        const cv::Rect2d box(column * column_width + margin + 14.0, kTop + 44.0 + row * (panel_height + kRowGap),
                             column_width - margin - 30.0, panel_height);
        draw_panel(canvas, plot.panels[i], box, x_interval, !shared_legend);
        if (last_of_column)
            canvas.text({box.x + box.width / 2.0, box.y + box.height + 44.0}, plot.x_label, kTextHeight_px,
                        Align::kCenter);
    }
    return canvas.save(file);
}

Status save_bars(const BarPlot& plot, const std::filesystem::path& file) {
    if (plot.groups.empty() || plot.sets.empty()) return invalid_input("bars '" + plot.title + "': nothing to draw");
    Panel range;  // for the range of the axis and its margin
    range.from_zero = true;
    range.y_label = plot.y_label;
    std::vector<LegendEntry> legend;
    for (std::size_t s = 0; s < plot.sets.size(); ++s) {
        const BarSet& set = plot.sets[s];
        if (set.values.size() != plot.groups.size() || (!set.sigma.empty() && set.sigma.size() != set.values.size()))
            return invalid_input("bars '" + plot.title + "', set '" + set.label +
                                 "': " + std::to_string(set.values.size()) + " values for " +
                                 std::to_string(plot.groups.size()) + " groups");
        Curve extent;
        for (std::size_t g = 0; g < set.values.size(); ++g) {
            const double reach = set.sigma.empty() ? 0.0 : 3.0 * set.sigma[g];
            extent.y.insert(extent.y.end(), {set.values[g] + reach, std::min(0.0, set.values[g] - reach)});
        }
        range.curves.push_back(extent);
        if (!set.label.empty()) legend.push_back({set.label, palette(s), false, false, true});
    }
    const int width = std::max(plot.width_px, 400), height = std::max(plot.height_px, 300);
    Canvas canvas(width, height);
    canvas.text({width / 2.0, 28.0}, plot.title, kTitleHeight_px, Align::kCenter);
    const double margin = left_margin(range) + 14.0;
    const double slot = (width - margin - 30.0) / static_cast<double>(plot.groups.size());
    double longest = 0.0;
    for (const std::string& group : plot.groups) longest = std::max(longest, Canvas::text_width(group, kSmall_px));
    const bool turned = longest > 0.95 * slot;
    const double below = turned ? std::min(longest + 30.0, 0.5 * height) : 50.0;
    const cv::Rect2d box(margin, 98.0, width - margin - 30.0, height - 98.0 - below);
    draw_legend_above(canvas, legend, box.x + box.width, box.y - 18.0, box.width);
    const Axis y{y_range(range), false, box.y + box.height, box.y};
    const std::vector<double> ticks = y.ticks(static_cast<int>(box.height / 55.0));
    for (const double tick : ticks) {
        canvas.line({box.x, y.map(tick)}, {box.x + box.width, y.map(tick)}, kGrid, 1.0);
        canvas.text({box.x - 10.0, y.map(tick)}, tick_text(tick, step_of(ticks)), kSmall_px, Align::kRight);
    }
    const double bar = 0.78 * slot / static_cast<double>(plot.sets.size());
    for (std::size_t g = 0; g < plot.groups.size(); ++g) {
        const double left = box.x + slot * (static_cast<double>(g) + 0.11);
        for (std::size_t s = 0; s < plot.sets.size(); ++s) {
            const double value = plot.sets[s].values[g];
            if (!std::isfinite(value)) continue;
            const double x = left + bar * static_cast<double>(s), top = y.map(value), foot = y.map(0.0);
            canvas.rectangle({x + 1.0, std::min(top, foot), bar - 2.0, std::abs(foot - top)}, palette(s));
            if (plot.sets[s].sigma.empty() || !std::isfinite(plot.sets[s].sigma[g])) continue;
            const double up = y.map(value + 3.0 * plot.sets[s].sigma[g]),
                         down = y.map(value - 3.0 * plot.sets[s].sigma[g]);
            const double middle = x + bar / 2.0, cap = std::min(8.0, bar / 4.0);
            canvas.line({middle, up}, {middle, down}, kInk, 1.6);
            canvas.line({middle - cap, up}, {middle + cap, up}, kInk, 1.6);
            canvas.line({middle - cap, down}, {middle + cap, down}, kInk, 1.6);
        }
        const double center = box.x + slot * (static_cast<double>(g) + 0.5);
        if (turned) {
            canvas.vertical_text(
                {center, box.y + box.height + 12.0 + Canvas::text_width(plot.groups[g], kSmall_px) / 2.0},
                plot.groups[g], kSmall_px);
        } else {
            canvas.text({center, box.y + box.height + 20.0}, plot.groups[g], kSmall_px, Align::kCenter);
        }
    }
    canvas.line({box.x, y.map(0.0)}, {box.x + box.width, y.map(0.0)}, kInk, 1.5);
    canvas.frame(box, kInk, 1.3);
    canvas.vertical_text({26.0, box.y + box.height / 2.0}, plot.y_label, kSmall_px);
    return canvas.save(file);
}

}  // namespace teres::tools
