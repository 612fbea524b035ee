// The whole verb, as a user runs it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/case/case_writer.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using test::run_teres;
using ::testing::HasSubstr;

class ScoreCommand : public ::testing::Test {
  protected:
    void SetUp() override {
        truth_ = test::block_truth(test::clamped_block(options_), options_);
        predicted_ = truth_;
        for (auto& sample : predicted_) sample.position_m[1] += 2e-3;
        ASSERT_TRUE(write_positions(scratch_.path() / "validation.csv", "point_id", truth_));
    }
    test::Run score(const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments{"score", scratch_.path().string(), prediction()};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run_teres(arguments);
    }
    std::string prediction() const { return (scratch_.path() / "predict.csv").string(); }

    test::ScratchFolder scratch_;
    test::BlockOptions options_{.motion = [](const Point& rest, double t_s) {
        return Point{rest[0], rest[1], rest[2] - 0.01 * t_s};
    }};
    std::vector<PositionSample> truth_, predicted_;
};

TEST_F(ScoreCommand, PrintsAndWritesTheErrors) {
    ASSERT_TRUE(write_positions(prediction(), "point_id", predicted_));
    const auto json_file = scratch_.path() / "score.json", plot_file = scratch_.path() / "score.png";
    const auto run = score({"--json", json_file.string(), "--plot", plot_file.string()});
    EXPECT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.output, HasSubstr("mean     2.000 mm"));
    const auto json = nlohmann::json::parse(*read_text_file(json_file));
    EXPECT_EQ(json["format"], "teres-score-1");
    EXPECT_EQ(json["positions"], truth_.size());
    EXPECT_NEAR(json["error_mm"]["rms"].get<double>(), 2.0, 1e-9);
    EXPECT_EQ(json["frames"].size(), 5u);
    EXPECT_GE(cv::imread(plot_file.string()).cols, 1400);
}

TEST_F(ScoreCommand, IncompletePredictionIsNotUsable) {
    predicted_.pop_back();
    ASSERT_TRUE(write_positions(prediction(), "point_id", predicted_));
    const auto run = score();
    EXPECT_EQ(run.exit_code, 1);
    EXPECT_THAT(run.error, HasSubstr("1 of 40 positions are not predicted: point 7 at t_s = 0.4"));
}

TEST_F(ScoreCommand, MalformedFilesAreInvalidInput) {
    EXPECT_EQ(score().exit_code, 2);  // no such file
    ASSERT_TRUE(write_text_file(prediction(), "t_s,point_id,x_m,y_m,z_m\n0,0,0.1,abc,0\n"));
    const auto run = score();
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_THAT(run.error, HasSubstr("predict.csv:2: y_m = 'abc', expected a finite number or NaN"));
    ASSERT_TRUE(write_positions(prediction(), "point_id", predicted_));
    std::filesystem::remove(scratch_.path() / "validation.csv");
    const auto no_truth = score();
    EXPECT_EQ(no_truth.exit_code, 2);
    EXPECT_THAT(no_truth.error, HasSubstr("validation.csv: file not found"));
    EXPECT_EQ(run_teres({"score"}).exit_code, 2);
}

TEST_F(ScoreCommand, PerfectPredictionOfTheLiverCaseScoresZero) {
    TERES_REQUIRE_DATA(folder, "febio/control");
    const auto run = run_teres({"score", folder.string(), (folder / "validation.csv").string()});
    EXPECT_EQ(run.exit_code, 0) << run.error;
    EXPECT_THAT(run.output, HasSubstr("3660 positions, 61 frames, 60 points"));
    EXPECT_THAT(run.output, HasSubstr("max      0.000 mm"));
}

}  // namespace
}  // namespace teres
