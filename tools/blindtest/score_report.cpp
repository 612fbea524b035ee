#include "tools/blindtest/score_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tools/canvas.h"
#include "tools/plot.h"

namespace teres::blindtest {
namespace {

std::string share(const Share& s) {
    return s.of == 0 ? "-" : fmt::format("{:.0f} % ({} of {})", s.percent(), s.right, s.of);
}

std::string percent(double fraction) {
    return std::isfinite(fraction) ? fmt::format("{:.0f} %", 100.0 * fraction) : "-";
}

std::string value(double x, const char* format, const char* unit) {
    return std::isfinite(x) ? fmt::format(fmt::runtime(format), x) + unit : "-";
}

// What was answered but for `truth`, with how often.
std::string answers_but(const std::map<std::string, int>& row, const std::string& truth) {
    std::string text;
    for (const auto& [answer, count] : row)
        if (answer != truth) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, answer);
    return text;
}

Status save_confusion(const Summary& s, const std::filesystem::path& file) {
    std::set<std::string> named;
    for (const auto& [truth, row] : s.confusion)
        for (const auto& [answer, count] : row) named.insert(answer);
    for (const auto& [truth, row] : s.confusion) named.insert(truth);
    std::vector<std::string> answers;
    for (const std::string& name : named)
        if (name != "none" && name != "unknown") answers.push_back(name);
    answers.insert(answers.end(), {"unknown", "none"});
    using tools::Canvas;
    double longest = 0.0;  // of the labels [px]: pairs are long
    for (const std::string& name : named) longest = std::max(longest, Canvas::text_width(name, 11));
    constexpr int kCell = 26;
    const int left = static_cast<int>(longest) + 30, top = left + 30;  // the title is above the columns' labels
    Canvas canvas(std::max(left + kCell * static_cast<int>(answers.size()) + 40, 420),
                  top + kCell * static_cast<int>(s.confusion.size()) + 30);
    canvas.text({20.0, 26.0}, "Truth (rows), answer (columns), cases", 14);
    for (std::size_t c = 0; c < answers.size(); ++c) {
        const double x = left + kCell * (static_cast<double>(c) + 0.5);
        canvas.vertical_text({x, top - 10.0 - 0.5 * Canvas::text_width(answers[c], 11)}, answers[c], 11);
    }
    double y = top;
    for (const auto& [truth, row] : s.confusion) {
        canvas.text({left - 10.0, y + 0.5 * kCell}, truth, 11, tools::Align::kRight);
        int total = 0;
        for (const auto& [answer, count] : row) total += count;
        for (std::size_t c = 0; c < answers.size(); ++c) {
            const auto found = row.find(answers[c]);
            const int count = found == row.end() ? 0 : found->second;
            const cv::Rect2d box(left + kCell * static_cast<double>(c), y, kCell, kCell);
            const double part = static_cast<double>(count) / total;
            if (count > 0) canvas.rectangle(box, tools::sequential(part));
            canvas.frame(box, answers[c] == truth ? tools::kInk : tools::kGrid, answers[c] == truth ? 2.0 : 1.0);
            if (count > 0)
                canvas.text({box.x + 0.5 * kCell, box.y + 0.5 * kCell}, std::to_string(count), 10,
                            tools::Align::kCenter, part > 0.45 ? tools::kPaper : tools::kInk);
        }
        y += kCell;
    }
    return canvas.save(file);
}

}  // namespace

std::string report_text(const Summary& s) {
    std::string text;
    const auto line = [&](const std::string& what, const std::string& figure) {
        text += fmt::format("| {} | {} |\n", what, figure);
    };
    text += "| blind test | |\n|---|---|\n";
    std::vector<double> floors;
    for (const auto& [body, floor] : s.body_floor_mm) floors.push_back(floor);
    line("floor: gap of a body's control without noise, median over bodies; visible: nominal gap above 1.5 x the own",
         fmt::format("{:.2f} mm", s.floor_mm) +
             (floors.empty() ? ""
                             : fmt::format(" ({:.2f} to {:.2f})", *std::min_element(floors.begin(), floors.end()),
                                           *std::max_element(floors.begin(), floors.end()))));
    line("top-1 / top-3, visible single causes", share(s.top1) + " / " + share(s.top3));
    line("right or within the family, visible", share(s.family));
    line("right or declared inseparable from the answer, visible", share(s.declared));
    line("top-1 / top-3, all single causes", share(s.top1_all) + " / " + share(s.top3_all));
    line("sensor against mechanics, where a cause is named", share(s.kind));
    line("false alarms on controls", share(s.false_alarm));
    line("causes below the floor answered `none`", share(s.invisible_none));
    line("answered `unknown` although in the catalogue, visible", share(s.false_unknown));
    line("effect withheld: `unknown` or its family / or what the full answer declares inseparable from it, visible",
         share(s.withheld_unknown) + " / " + share(s.withheld_declared));
    line("two causes, each visible: both named / at least one", share(s.two_both) + " / " + share(s.two_one));
    line("two causes, one visible: that or both named", share(s.two_seen));
    line("place of located causes, right cause, median", value(median(s.place_mm), "{:.1f}", " mm"));
    line("error of inner points removed (noise-free truth), right / wrong cause, median",
         percent(median(s.true_shrinkage)) + " / " + percent(median(s.wrong_shrinkage)));
    line("... of mechanical causes within the stated 95 % interval", share(s.coverage));
    line("calibration error (ECE); calibrated answers as few as these",
         fmt::format("{:.3f}; {:.3f}", s.ece, s.ece_of_chance));
    line("one diagnosis, median / largest",
         value(median(s.seconds), "{:.1f}", " s / ") +
             (s.seconds.empty() ? "-" : value(*std::max_element(s.seconds.begin(), s.seconds.end()), "{:.1f}", " s")));
    line("peak memory, largest",
         s.peak_mb.empty() ? "-" : value(*std::max_element(s.peak_mb.begin(), s.peak_mb.end()), "{:.0f}", " MB"));
    line("diagnosis failed", std::to_string(s.failed));
    text +=
        "\n| effect | visible | top-1 | top-3 | family | place, median | answered instead "
        "|\n|---|---|---|---|---|---|---|\n";
    for (const auto& [id, row] : s.effects) {
        const auto found = s.confusion.find(id);
        text += fmt::format("| `{}` | {} | {} | {} | {} | {} | {} |\n", id, row.visible, row.top1.right, row.top3.right,
                            row.family.right, value(median(row.place_mm), "{:.0f}", " mm"),
                            found != s.confusion.end() ? answers_but(found->second, id) : "");
    }
    text +=
        "\n| control, or two causes of which one shows at least | cases | answered so | answered instead "
        "|\n|---|---|---|---|\n";
    for (const auto& [truth, row] : s.confusion) {
        if (s.effects.contains(truth)) continue;
        const auto right = row.find(truth);
        int cases = 0;
        for (const auto& [answer, count] : row) cases += count;
        text += fmt::format("| `{}` | {} | {} | {} |\n", truth, cases, right == row.end() ? 0 : right->second,
                            answers_but(row, truth));
    }
    text += "\n| stated probability | answers | stated, mean | right |\n|---|---|---|---|\n";
    for (std::size_t b = 0; b < s.reliability.size(); ++b) {
        const ReliabilityBin& bin = s.reliability[b];
        if (bin.right.of > 0)
            text += fmt::format("| {} to {} % | {} | {:.0f} % | {} |\n", 10 * b, 10 * (b + 1), bin.right.of,
                                100.0 * bin.mean_probability, share(bin.right));
    }
    return text;
}

Status save_plots(const Summary& s, const std::filesystem::path& folder) {
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    if (failed) return host_fault(folder.string() + ": " + failed.message());
    if (!s.confusion.empty()) TERES_TRY(save_confusion(s, folder / "confusion.png"));

    tools::Curve reached{.label = "answers", .x = {}, .y = {}},
        ideal{.label = "calibrated", .x = {0.0, 1.0}, .y = {0.0, 1.0}, .dashed = true};
    for (const ReliabilityBin& bin : s.reliability)
        if (bin.right.of > 0) {
            reached.x.push_back(bin.mean_probability);
            reached.y.push_back(static_cast<double>(bin.right.right) / bin.right.of);
        }
    tools::Plot plot;
    plot.title = fmt::format("Reliability of the answers, ECE {:.3f}", s.ece);
    plot.x_label = "stated probability";
    plot.width_px = 900;
    plot.panel_height_px = 700;
    plot.panels.push_back({.y_label = "share right", .from_zero = true, .curves = {reached, ideal}});
    TERES_TRY(tools::save_plot(plot, folder / "reliability.png"));

    if (s.effects.empty()) return {};
    tools::BarPlot bars;
    bars.title = "Visible causes named right";
    bars.y_label = "share [%]";
    bars.width_px = 2200;
    tools::BarSet top1{"top 1", {}}, top3{"top 3", {}};
    for (const auto& [id, row] : s.effects) {
        bars.groups.push_back(id);
        top1.values.push_back(row.top1.percent());
        top3.values.push_back(row.top3.percent());
    }
    bars.sets = {top1, top3};
    return tools::save_bars(bars, folder / "effects.png");
}

}  // namespace teres::blindtest
