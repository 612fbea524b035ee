#include "tools/plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "tests/support/test_data.h"
#include "tools/canvas.h"

namespace teres::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Pixels within 12 grey levels of a colour, and where they are.
struct Found {
    int count = 0;
    cv::Rect box;
};
Found find(const cv::Mat& image, Color color) {
    cv::Mat mask;
    const cv::Scalar bgr(color.b, color.g, color.r), tolerance = cv::Scalar::all(12.0);
    cv::inRange(image, bgr - tolerance, bgr + tolerance, mask);
    std::vector<cv::Point> at;
    cv::findNonZero(mask, at);
    Found found{static_cast<int>(at.size()), {}};
    for (const cv::Point& p : at) found.box |= cv::Rect(p, cv::Size(1, 1));
    return found;
}

TEST(RoundTicks, AreOneTwoOrFiveTimesAPowerOfTen) {
    EXPECT_THAT(round_ticks(0.0, 10.0), ElementsAre(0, 2, 4, 6, 8, 10));
    EXPECT_THAT(round_ticks(-0.03, 0.11, 5), ElementsAre(0.0, 0.05, 0.1));
    EXPECT_THAT(round_ticks(3.0, 3.0), ElementsAre(3.0));
    for (const double high : {1e-7, 0.3, 17.0, 4e6}) {
        const auto ticks = round_ticks(-0.2 * high, high, 6);
        EXPECT_GE(ticks.size(), 3u);
        EXPECT_LE(ticks.size(), 8u);
        EXPECT_GE(ticks.front(), -0.2 * high);
        EXPECT_LE(ticks.back(), high * (1.0 + 1e-12));
    }
}

TEST(LogTicks, AreDecadesAndWhereFewTwosAndFives) {
    EXPECT_THAT(log_ticks(0.9, 110.0), ElementsAre(1, 2, 5, 10, 20, 50, 100));
    EXPECT_THAT(log_ticks(1.0, 1e4), ElementsAre(1, 10, 100, 1000, 10000));
    EXPECT_TRUE(log_ticks(0.0, 10.0).empty());
}

TEST(TickText, HasTheDecimalsThatTheStepNeeds) {
    EXPECT_EQ(tick_text(0.2, 0.1), "0.2");
    EXPECT_EQ(tick_text(2.0, 0.05), "2.00");
    EXPECT_EQ(tick_text(20.0, 10.0), "20");
    EXPECT_EQ(tick_text(2e6, 1e6), "2e+06");
    EXPECT_EQ(tick_text(2e-5, 1e-5), "2e-05");
}

TEST(Plot, DrawsEveryCurveAndIsWideEnough) {
    const test::ScratchFolder scratch;
    const auto file = scratch.path() / "plot.png";
    Plot plot;
    plot.title = "two curves";
    plot.x_label = "time [s]";
    Curve rising{"rising", {}, {}}, falling{"falling", {}, {}};
    for (int i = 0; i <= 50; ++i) {
        rising.x.push_back(0.1 * i);
        rising.y.push_back(0.1 * i);
        falling.x.push_back(0.1 * i);
        falling.y.push_back(5.0 - 0.1 * i);
    }
    plot.panels.push_back({.y_label = "error [mm]", .curves = {rising, falling}});
    ASSERT_TRUE(save_plot(plot, file));
    const cv::Mat image = cv::imread(file.string());
    ASSERT_GE(image.cols, 1400);
    for (const std::size_t i : {0u, 1u}) {
        const Found found = find(image, palette(i));
        EXPECT_GT(found.count, 1000);
        EXPECT_GT(found.box.width, image.cols * 3 / 4);  // from the first to the last second
        EXPECT_GT(found.box.height, image.rows / 2);
    }
}

TEST(Plot, GapsInACurveStayEmpty) {
    const test::ScratchFolder scratch;
    const auto whole = scratch.path() / "whole.png", gap = scratch.path() / "gap.png";
    Curve curve{"", {}, {}};
    for (int i = 0; i <= 100; ++i) {
        curve.x.push_back(i);
        curve.y.push_back(1.0 + std::sin(0.1 * i));
    }
    Plot plot;
    plot.panels.push_back({.curves = {curve}});
    ASSERT_TRUE(save_plot(plot, whole));
    for (std::size_t i = 30; i < 70; ++i) plot.panels[0].curves[0].y[i] = kNaN;
    ASSERT_TRUE(save_plot(plot, gap));
    const int full = find(cv::imread(whole.string()), palette(0)).count;
    const int rest = find(cv::imread(gap.string()), palette(0)).count;
    EXPECT_LT(rest, 0.75 * full);
    EXPECT_GT(rest, 0.4 * full);
}

TEST(Plot, BandReachesThreeSigma) {
    const test::ScratchFolder scratch;
    const auto file = scratch.path() / "band.png";
    Plot plot;
    plot.panel_height_px = 500;
    Panel panel;
    panel.curves.push_back({"", {0.0, 1.0}, {0.0, 0.0}, {1.0, 1.0}});
    panel.curves.push_back({"", {0.0, 1.0}, {-6.0, 6.0}});  // sets the range: +-6 over the panel
    plot.panels.push_back(panel);
    ASSERT_TRUE(save_plot(plot, file));
    // one fifth of the palette's blue on white, as the band is drawn
    const Color blue = palette(0);
    const Color band{255 - 0.2 * (255 - blue.r), 255 - 0.2 * (255 - blue.g), 255 - 0.2 * (255 - blue.b)};
    const Found found = find(cv::imread(file.string()), band);
    // range [-6, 6] padded by 6 % on each side: 500 px / 13.44; the band is 6 high
    EXPECT_NEAR(found.box.height, 6.0 * 500.0 / 13.44, 6.0);
}

TEST(Plot, LogAxisLeavesOutWhatItCannotShow) {
    const test::ScratchFolder scratch;
    Plot plot;
    plot.panels.push_back(
        {.log_y = true, .curves = {{"", {0, 1, 2, 3}, {0.0, -1.0, 10.0, 1e3}, {1.0, 1.0, 100.0, 10.0}}}});
    EXPECT_TRUE(save_plot(plot, scratch.path() / "log.png"));
    plot.panels[0].curves[0].y = {0.0, 0.0, -1.0, kNaN};  // nothing to show at all
    EXPECT_TRUE(save_plot(plot, scratch.path() / "none.png"));
    EXPECT_FALSE(cv::imread((scratch.path() / "none.png").string()).empty());
}

TEST(Plot, ManyPanelsShareColumns) {
    const test::ScratchFolder scratch;
    Plot plot;
    plot.columns = 2;
    for (int i = 0; i < 5; ++i)
        plot.panels.push_back({.title = "r" + std::to_string(i), .curves = {{"estimate", {0, 1}, {0.0, 1.0 * i}}}});
    ASSERT_TRUE(save_plot(plot, scratch.path() / "grid.png"));
    const cv::Mat image = cv::imread((scratch.path() / "grid.png").string());
    EXPECT_GT(image.rows, 3 * 220);
}

TEST(Plot, WrongInputIsAnErrorNotACrash) {
    const test::ScratchFolder scratch;
    Plot plot;
    plot.title = "t";
    EXPECT_EQ(save_plot(plot, scratch.path() / "p.png").error().kind, ErrorKind::kInvalidInput);
    plot.panels.push_back({.curves = {{"c", {0, 1, 2}, {0, 1}}}});
    EXPECT_THAT(save_plot(plot, scratch.path() / "p.png").error().text, HasSubstr("curve 'c': 3 x, 2 y, 0 sigma"));
    plot.panels[0].curves[0].y.push_back(2);
    const auto status = save_plot(plot, scratch.path() / "no such folder" / "p.png");
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, ErrorKind::kHostFault);
    EXPECT_THAT(status.error().text, HasSubstr("p.png: cannot be written"));
}

TEST(Bars, HeightsFollowTheValues) {
    const test::ScratchFolder scratch;
    const auto file = scratch.path() / "bars.png";
    BarPlot bars;
    bars.title = "bars";
    bars.y_label = "error [mm]";
    bars.groups = {"a"};
    bars.sets = {{"", {8.0}}, {"", {2.0}}};
    ASSERT_TRUE(save_bars(bars, file));
    const cv::Mat image = cv::imread(file.string());
    const Found tall = find(image, palette(0)), low = find(image, palette(1));
    EXPECT_NEAR(static_cast<double>(tall.box.height) / low.box.height, 4.0, 0.1);
    bars.sets[0].values.push_back(1.0);
    EXPECT_THAT(save_bars(bars, file).error().text, HasSubstr("2 values for 1 groups"));
}

}  // namespace
}  // namespace teres::tools
