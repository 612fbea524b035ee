// The main job as a user runs it, against truth of independent solvers: the bundled demo case (CalculiX) and,
// where the data is there, the FEBio control case. Figures: VALIDATION.md, "Main job".
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/program.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

struct Outcome {
    double estimated_mm = 0.0, fixed_mm = 0.0;
    nlohmann::json json;
};

nlohmann::json read_json(const std::filesystem::path& file) {
    std::ifstream in(file);
    return nlohmann::json::parse(in);
}

double mean_error_mm(const std::filesystem::path& folder, const std::filesystem::path& prediction) {
    const std::filesystem::path json = prediction.string() + ".json";
    const test::Run run = test::run_program(test::program_path("teres"), {"score", folder, prediction, "--json", json});
    EXPECT_EQ(run.exit_code, 0) << run.error;
    return read_json(json)["error_mm"]["mean"];
}

Outcome estimate(const std::filesystem::path& folder) {
    const test::ScratchFolder scratch;
    const auto at = [&](const char* name) { return (scratch.path() / name).string(); };
    Outcome out;
    const test::Run estimated = test::run_program(
        test::program_path("teres"), {"estimate", folder, "--json", at("e.json"), "--predict", at("e.csv")});
    EXPECT_EQ(estimated.exit_code, 0) << estimated.error;
    const test::Run fixed = test::run_program(test::program_path("teres"),
                                              {"estimate", folder, "--bc", "atlas-fixed", "--predict", at("f.csv")});
    EXPECT_EQ(fixed.exit_code, 0) << fixed.error;
    if (testing::Test::HasFailure()) return out;
    out.json = read_json(at("e.json"));
    out.estimated_mm = mean_error_mm(folder, at("e.csv"));
    out.fixed_mm = mean_error_mm(folder, at("f.csv"));
    std::printf("| %s | %.2f | %.2f | %.0f %% | %.2f / %.2f / %.2f |\n", folder.filename().c_str(), out.fixed_mm,
                out.estimated_mm, 100.0 * (1.0 - out.estimated_mm / out.fixed_mm),
                out.json["marker_rms_mm"]["prior"].get<double>(), out.json["marker_rms_mm"]["fixed"].get<double>(),
                out.json["marker_rms_mm"]["estimated"].get<double>());
    return out;
}

void expect_contract(const nlohmann::json& json) {
    EXPECT_EQ(json["format"], "teres-estimate-1");
    EXPECT_GT(json["parameters"].size(), 0u);
    for (const auto& p : json["parameters"]) {
        EXPECT_GT(p["stdev"].get<double>(), 0.0) << p["name"];
        EXPECT_GE(p["observability"].get<double>(), 0.0);
        EXPECT_LE(p["observability"].get<double>(), 1.0);
    }
    for (const auto& a : json["attachment"]) {
        EXPECT_GE(a["probability"].get<double>(), 0.0);
        EXPECT_LE(a["probability"].get<double>(), 1.0);
    }
}

// Inner points within the 2 mm and at most half of the error with the atlas region held fixed.
void expect_accurate(const Outcome& out) {
    EXPECT_LE(out.estimated_mm, 2.0);
    EXPECT_LE(out.estimated_mm, 0.5 * out.fixed_mm);
    EXPECT_LT(out.json["marker_rms_mm"]["estimated"].get<double>(), out.json["marker_rms_mm"]["prior"].get<double>());
}

TEST(Estimate, FindsTheLigamentOfTheDemoCase) {
    const std::filesystem::path source = std::getenv("TERES_SOURCE_DIR");
    const Outcome out = estimate(source / "config/cases/demo");
    ASSERT_FALSE(HasFailure());
    expect_contract(out.json);
    expect_accurate(out);

    // Attachment: nodes of the true band (truth.json) are more probable than the others of the prior region.
    const nlohmann::json truth = read_json(source / "config/cases/demo/truth.json");
    const auto nodes = truth["ligament"]["attachment_node_ids"].get<std::vector<int>>();
    double inside = 0.0, outside = 0.0;
    int num_inside = 0, num_outside = 0;
    for (const auto& a : out.json["attachment"]) {
        const bool is_inside = std::find(nodes.begin(), nodes.end(), a["node_id"].get<int>()) != nodes.end();
        (is_inside ? inside : outside) += a["probability"].get<double>();
        ++(is_inside ? num_inside : num_outside);
    }
    std::printf("attachment probability: %.2f on the true band, %.2f beside it\n", inside / num_inside,
                outside / num_outside);
    EXPECT_GT(inside / num_inside, outside / num_outside + 0.2);
}

TEST(Estimate, FindsTheLigamentOfTheFebioControl) {
    TERES_REQUIRE_DATA(folder, "febio/control");
    const Outcome out = estimate(folder);
    ASSERT_FALSE(HasFailure());
    expect_contract(out.json);
    expect_accurate(out);
}

}  // namespace
}  // namespace teres
