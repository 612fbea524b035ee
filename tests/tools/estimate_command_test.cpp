// The whole verb on a case with a known answer. A stiff block hangs by a soft band on its face x = 0 and is
// pulled along x: it moves as one piece, u = F / k, where k is the sum of the groups' stiffnesses along the
// normal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/text_file.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using test::run_teres;
using ::testing::HasSubstr;

constexpr double kForce = 0.5;        // N at the last frame
constexpr double kStiffness = 100.0;  // N/m, the truth

class EstimateCommand : public ::testing::Test {
  protected:
    // displacement_scale: 1 for markers that obey the truth.
    void write(double displacement_scale, double lost_from_s = 1e9) {
        constexpr int kFrames = 6;
        constexpr double kDt = 0.2;
        Case c =
            test::clamped_block({.cells = {8, 4, 4},
                                 .youngs_modulus_pa = 5e6,
                                 .frames = kFrames,
                                 .dt_s = kDt,
                                 .full_force_n = {kForce, 0.0, 0.0},
                                 .motion = [&](const Point& rest, double t_s) {
                                     const double force = kForce * t_s / (kDt * (kFrames - 1));
                                     return Point{rest[0] + displacement_scale * force / kStiffness, rest[1], rest[2]};
                                 }});
        c.name = "hanging block";
        c.clamped.clear();
        c.ligament = LigamentData{LigamentLaw::kNeoHookean, 20e3, 0.45, 0.02, 0.02, 0.0};
        for (std::size_t n = 0; n < c.mesh.nodes.size(); ++n) {
            const Point& p = c.mesh.nodes[n];
            // Inside of the face only: there the normal is -x.
            if (p[0] == 0.0 && p[1] > 0.001 && p[1] < 0.029 && p[2] > 0.001 && p[2] < 0.029)
                c.ligament_prior.push_back({static_cast<std::int32_t>(n), 0.9});
        }
        for (PositionSample& sample : c.observations)
            if (sample.t_s >= lost_from_s) sample.position_m.fill(std::numeric_limits<double>::quiet_NaN());
        ASSERT_TRUE(write_case(c, folder()));
    }
    std::string folder() const { return (scratch_.path() / "case").string(); }
    std::string at(const char* name) const { return (scratch_.path() / name).string(); }
    test::Run estimate(std::vector<std::string> more = {}) const {
        std::vector<std::string> arguments{"estimate", folder(), "--set", "simulation.num_groups=2"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run_teres(arguments);
    }

    test::ScratchFolder scratch_;
};

TEST_F(EstimateCommand, FindsTheStiffnessThatHoldsTheBlock) {
    write(1.0);
    const test::Run run = estimate({"--json", at("e.json"), "--predict", at("p.csv")});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const auto json = nlohmann::json::parse(*read_text_file(at("e.json")));
    EXPECT_EQ(json["format"], "teres-estimate-1");
    EXPECT_EQ(json["case"], "hanging block");
    EXPECT_EQ(json["frames"], 6);
    ASSERT_EQ(json["parameters"].size(), 2u);
    double sum = 0.0;
    for (const auto& p : json["parameters"]) {
        EXPECT_EQ(p["unit"], "N/m");
        EXPECT_GT(p["stdev"].get<double>(), 0.0);
        sum += p["mean"].get<double>();
    }
    EXPECT_NEAR(sum, kStiffness, 0.1 * kStiffness);
    EXPECT_EQ(json["attachment"].size(), 9u);
    EXPECT_LT(json["marker_rms_mm"]["estimated"].get<double>(), json["marker_rms_mm"]["prior"].get<double>());
    EXPECT_LT(json["marker_rms_mm"]["estimated"].get<double>(), 0.3);
    // Predicted points of the last frame moved by F / k = 5 mm, of which the block's own stretch is 1e-4 m at
    // most.
    const auto table = read_positions(at("p.csv"), "point_id");
    ASSERT_TRUE(table) << table.error().text;
    const auto rest = read_case(folder())->validation_rest;
    ASSERT_EQ(table->size(), 6 * rest.size());
    for (std::size_t i = 0; i < rest.size(); ++i)
        EXPECT_NEAR((*table)[5 * rest.size() + i].position_m[0] - rest[i].position_m[0], kForce / kStiffness, 4e-4);
}

TEST_F(EstimateCommand, BothFiltersAgree) {
    write(1.0);
    double sum[2] = {0.0, 0.0};
    for (int ukf = 0; ukf < 2; ++ukf) {
        const test::Run run =
            estimate({"--json", at("e.json"), "--set", ukf ? "estimator.filter=ukf" : "estimator.filter=roukf"});
        ASSERT_EQ(run.exit_code, 0) << run.error;
        for (const auto& p : nlohmann::json::parse(*read_text_file(at("e.json")))["parameters"])
            sum[ukf] += p["mean"].get<double>();
    }
    // The same filter for a quasi-static model: it has no memory but its parameters. 1e-3: residual of the
    // solver.
    EXPECT_NEAR(sum[0], sum[1], 1e-3 * sum[0]);
}

TEST_F(EstimateCommand, RefusesResultsThatContradictTheModel) {
    write(-8.0);  // the block moves against the pull
    const test::Run run = estimate({"--json", at("e.json")});
    EXPECT_EQ(run.exit_code, 1);
    EXPECT_THAT(run.error, HasSubstr("contradict the model"));
    EXPECT_TRUE(std::filesystem::exists(at("e.json")));  // written all the same, to be looked at
}

TEST_F(EstimateCommand, RefusesARecordingThatLosesItsMarkers) {
    write(1.0, 0.1);  // only the first frame shows any
    const test::Run few = estimate();
    EXPECT_EQ(few.exit_code, 1);
    EXPECT_THAT(few.error, HasSubstr("5 of 6 frames corrected nothing"));
    write(1.0, 0.0);
    const test::Run none = estimate();
    EXPECT_EQ(none.exit_code, 2);
    EXPECT_THAT(none.error, HasSubstr("observations.csv: all 48 rows are NaN"));
}

TEST_F(EstimateCommand, RefusesWrongUsage) {
    write(1.0);
    EXPECT_EQ(estimate({"--bc", "guessed"}).exit_code, 2);
    const test::Run setting = estimate({"--set", "estimator.gate_probability=1.5"});
    EXPECT_EQ(setting.exit_code, 2);
    EXPECT_THAT(setting.error, HasSubstr("estimator.gate_probability"));
    EXPECT_EQ(run_teres({"estimate", at("nowhere")}).exit_code, 2);
}

}  // namespace
}  // namespace teres
