#include "tools/score.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/support/synthetic_case.h"

namespace teres::tools {
namespace {

using ::testing::HasSubstr;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Two frames of three points; errors by hand: 0, 1, 2 mm and 3, 4, 10 mm.
std::vector<PositionSample> truth() {
    std::vector<PositionSample> out;
    for (const double t_s : {0.0, 0.2})
        for (const std::int32_t id : {0, 1, 7}) out.push_back({t_s, id, {0.01 * id, t_s, -0.05}});
    return out;
}

std::vector<PositionSample> prediction() {
    std::vector<PositionSample> out = truth();
    const std::array<double, 6> error_m{0.0, 0.001, 0.002, 0.003, 0.004, 0.010};
    for (std::size_t i = 0; i < out.size(); ++i) out[i].position_m[i % 3] += error_m[i];
    return out;
}

TEST(Score, MatchesPenAndPaper) {
    const auto score = score_prediction(truth(), prediction());
    ASSERT_TRUE(score) << score.error().text;
    EXPECT_EQ(score->num_positions, 6u);
    EXPECT_EQ(score->num_points, 3u);
    EXPECT_EQ(score->num_missing, 0u);
    EXPECT_NEAR(score->mean_mm, 20.0 / 6.0, 1e-9);
    EXPECT_NEAR(score->rms_mm, std::sqrt((1.0 + 4.0 + 9.0 + 16.0 + 100.0) / 6.0), 1e-9);
    EXPECT_NEAR(score->median_mm, 2.5, 1e-9);
    EXPECT_NEAR(score->p95_mm, 4.0 + 0.75 * 6.0, 1e-9);  // rank 0.95 * 5 = 4.75
    EXPECT_NEAR(score->max_mm, 10.0, 1e-9);
    EXPECT_EQ(score->max_point_id, 7);
    EXPECT_EQ(score->max_t_s, 0.2);
    ASSERT_EQ(score->frames.size(), 2u);
    EXPECT_NEAR(score->frames[0].mean_mm, 1.0, 1e-9);
    EXPECT_NEAR(score->frames[1].mean_mm, 17.0 / 3.0, 1e-9);
    EXPECT_EQ(score->worst_frame, 1u);
}

TEST(Score, OrderOfRowsDoesNotMatter) {
    auto shuffled = prediction();
    std::reverse(shuffled.begin(), shuffled.end());
    const auto a = score_prediction(truth(), prediction()), b = score_prediction(truth(), shuffled);
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->mean_mm, b->mean_mm);
    EXPECT_EQ(a->max_mm, b->max_mm);
}

TEST(Score, TimesMayBeRoundedButNotShifted) {
    auto rounded = prediction();
    for (auto& sample : rounded) sample.t_s += 2e-4;
    EXPECT_EQ(score_prediction(truth(), rounded)->num_missing, 0u);
    for (auto& sample : rounded) sample.t_s += 0.05;
    const auto shifted = score_prediction(truth(), rounded);
    ASSERT_TRUE(shifted);
    EXPECT_EQ(shifted->num_missing, 6u);
    EXPECT_EQ(shifted->num_ignored, 6u);
    EXPECT_TRUE(std::isnan(shifted->mean_mm));
}

TEST(Score, NamesWhatIsMissing) {
    auto incomplete = prediction();
    incomplete[4].position_m = {kNaN, kNaN, kNaN};
    incomplete.erase(incomplete.begin() + 2);
    const auto score = score_prediction(truth(), incomplete);
    ASSERT_TRUE(score) << score.error().text;
    EXPECT_EQ(score->num_positions, 4u);
    EXPECT_EQ(score->num_missing, 2u);
    ASSERT_EQ(score->missing.size(), 2u);
    EXPECT_EQ(score->missing[0], "point 7 at t_s = 0");
    EXPECT_EQ(score->missing[1], "point 1 at t_s = 0.2 (NaN)");
}

TEST(Score, LostTruthIsNotAskedFor) {
    auto lost = truth();
    lost[3].position_m = {kNaN, kNaN, kNaN};
    const auto score = score_prediction(lost, prediction());
    ASSERT_TRUE(score);
    EXPECT_EQ(score->num_positions, 5u);
    EXPECT_EQ(score->num_missing, 0u);
}

TEST(Score, RefusesUnknownAndDoublePoints) {
    auto unknown = prediction();
    unknown[1].id = 99;
    EXPECT_THAT(score_prediction(truth(), unknown).error().text, HasSubstr("point_id 99 at t_s = 0 is not a point"));
    auto twice = prediction();
    twice.push_back(twice[5]);
    EXPECT_THAT(score_prediction(truth(), twice).error().text, HasSubstr("point_id 7 at t_s = 0.2 is predicted twice"));
    EXPECT_FALSE(score_prediction({}, prediction()));
}

}  // namespace
}  // namespace teres::tools
