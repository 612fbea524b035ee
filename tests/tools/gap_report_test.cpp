// The report of a small made-up diagnosis: complete in itself, its numbers in the tables, and drawn by a real browser.
#include "tools/gap_report.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "tests/support/browser.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres::tools {
namespace {

using Json = nlohmann::json;

std::string text_of(const std::filesystem::path& file) {
    std::stringstream all;
    all << std::ifstream(file).rdbuf();
    return all.str();
}

// A block whose far half rises by 5 mm from 1 s on; four markers see it.
Json sample(const TetMeshData& mesh) {
    const Surface surface(mesh);
    Json j = Json::parse(R"({"format":"teres-gap-report-1","case":"block <1>",
      "gap":{"rms_mm":4.2,"noise_floor_mm":0.5,"significant":true},
      "where":{"kind":"load","center_m":[0.09,0.015,0.03],"radius_m":0.01,"onset_s":1.0,
        "other_places":[{"center_m":[0.09,0.015,0.0],"odds":0.4}],"markers":[]},
      "causes":[{"effects":["unknown_load"],"probability":0.91,"parameters":[{"name":"force_z","unit":"N","mean":0.4,"stdev":0.05}],
                 "confusable_with":["pressure"],"confusable_with_pairs":[["lens_distortion","registration"]],"score":20.0,"explained":0.97},
                {"effects":["gravity"],"probability":0.05,"parameters":[],"confusable_with":["pressure"],"score":9.0,"explained":0.5}],
      "unknown_probability":0.03,"none_probability":0.01,
      "shrinkage":{"effects":["unknown_load"],"heldout":"frames 8-9","before_rms_mm":4.0,"after_rms_mm":0.4,"fraction":0.9,"ci95":[0.85,0.94]},
      "next_experiment":"track the instruments",
      "ladder":[{"effects":[],"model_error":false,"fitted_rms_mm":4.2,"heldout_rms_mm":4.0},{"effects":["unknown_load"],"model_error":false,"fitted_rms_mm":0.5,"heldout_rms_mm":0.4}],
      "transfers":[],
      "maps":[{"effect":"extra_attachment","center_m":[0.0,0.015,0.03,0.1,0.015,0.03],"explained":[0.05,0.62]}],
      "identifiability":{"effects":["gravity","unknown_load"],"visibility_chi2":[100.0,4000.0],"visible":[false,true],
        "overlap":[[1.0,0.2],[0.4,1.0]],"inseparable":[],"not_in_question":[{"effect":"cut","why":"excluded on request"}]},
      "catalogue":{"unknown_load":{"summary":"another tool","kind":"load","family":"unknown_load"},"gravity":{"summary":"tilt","kind":"load","family":"gravity"}}})");
    Json triangles = Json::array();
    for (const auto& t : surface.triangles())
        for (const std::int32_t n : t)
            triangles.push_back(std::lower_bound(surface.nodes().begin(), surface.nodes().end(), n) -
                                surface.nodes().begin());
    j["surface"] = {{"node_id", surface.nodes()},
                    {"triangle", triangles},
                    {"unit_m", 1e-4},
                    {"before", Json::array()},
                    {"after", Json::array()}};
    j["time_s"] = Json::array();
    j["markers"] = {{"marker_id", {10, 11, 12, 13}}, {"observed_m", Json::array()}, {"before_m", Json::array()},
                    {"after_m", Json::array()},      {"first_held_frame", 8},       {"held_markers", Json::array()}};
    for (int id = 10; id < 14; ++id) j["where"]["markers"].push_back({{"marker_id", id}, {"share", 0.25}});
    for (int f = 0; f < 10; ++f) {
        j["time_s"].push_back(0.2 * f);
        Json before = Json::array(), after = Json::array();
        for (const std::int32_t n : surface.nodes())
            for (std::size_t a = 0; a < 3; ++a) {
                const Point& p = mesh.nodes[static_cast<std::size_t>(n)];
                const double rise = f >= 5 && a == 2 && p[0] > 0.05 ? 0.005 : 0.0;
                before.push_back(std::lround(1e4 * p[a]));
                after.push_back(std::lround(1e4 * (p[a] + rise)));
            }
        j["surface"]["before"].push_back(before);
        j["surface"]["after"].push_back(after);
        for (int m = 0; m < 4; ++m)
            for (int a = 0; a < 3; ++a) {
                const double rest = a == 0   ? 0.02 + 0.02 * m
                                    : a == 1 ? 0.015
                                             : 0.03,
                             rise = f >= 5 && a == 2 && m > 1 ? 0.005 : 0.0;
                const bool lost = m == 3 && f == 7;
                j["markers"]["observed_m"].push_back(lost ? Json(nullptr) : Json(rest + rise));
                j["markers"]["before_m"].push_back(rest);
                j["markers"]["after_m"].push_back(rest + 0.9 * rise);
            }
    }
    return j;
}

TEST(GapReport, IsOneFileWithTablesAndPicturesBesideIt) {
    const test::ScratchFolder scratch;
    const TetMeshData mesh = test::block_mesh({0.10, 0.03, 0.03}, {10, 3, 3});
    const auto folder = scratch.path() / "a" / "report";
    const auto status = write_gap_report(sample(mesh).dump(), mesh, {}, folder);
    ASSERT_TRUE(status) << status.error().text;
    const std::string page = text_of(folder / "index.html");
    EXPECT_NE(page.find("unknown_load (91 %)"), std::string::npos);
    EXPECT_NE(page.find("cannot be told from pressure, lens_distortion with registration."), std::string::npos);
    EXPECT_NE(page.find("may as well be near x 90, y 15, z 0 mm (odds 0.4)"), std::string::npos);
    EXPECT_NE(page.find("block &lt;1&gt;"), std::string::npos) << "names cannot inject markup";
    for (const char* outside : {"http://", "https://", "src=", "@import", "@DATA@", "@VERDICT@", "@TITLE@"})
        EXPECT_EQ(page.find(outside), std::string::npos) << outside;
    // frame 5: markers 2 and 3 are 5 mm off before, 0.5 mm after; rms over 4 markers
    const std::string residuals = text_of(folder / "residuals.csv");
    EXPECT_NE(residuals.find("1,3.5355,0.35355"), std::string::npos) << residuals;
    EXPECT_NE(text_of(folder / "causes.csv").find("unknown_load,0.91,0.97"), std::string::npos);
    EXPECT_NE(text_of(folder / "surface_gap.csv").find(",5\n"), std::string::npos);
    EXPECT_NE(text_of(folder / "place_maps.csv").find("extra_attachment,0.1,0.015,0.03,0.62\n"), std::string::npos);
    for (const char* picture : {"residuals.png", "causes.png", "surface_gap.png"})
        EXPECT_FALSE(cv::imread((folder / picture).string()).empty()) << picture;
}

TEST(GapReport, VerdictSaysNoneAndUnknownInPlainWords) {
    const TetMeshData mesh = test::block_mesh({0.10, 0.03, 0.03}, {2, 1, 1});
    Json j = sample(mesh);
    j["shrinkage"]["effects"] = Json::array();
    j["none_probability"] = 0.9;
    EXPECT_NE(verdict_text(j.dump()).find("Nothing is missing"), std::string::npos);
    j["none_probability"] = 0.05;
    j["unknown_probability"] = 0.8;
    EXPECT_NE(verdict_text(j.dump()).find("not in the catalogue"), std::string::npos);
}

// What a browser draws: the body in colour, and tables filled by the script.
TEST(GapReport, IsDrawnByHeadlessChromium) {
    const char* browser = test::Browser::kProgram;
    if (!test::Browser::installed()) GTEST_SKIP() << "SKIPPED LOUDLY: no " << browser << " (apt install chromium)";
    const test::ScratchFolder scratch;
    const TetMeshData mesh = test::block_mesh({0.10, 0.03, 0.03}, {10, 3, 3});
    ASSERT_TRUE(write_gap_report(sample(mesh).dump(), mesh, {}, scratch.path()));
    const std::string picture = (scratch.path() / "page.png").string(),
                      url = "file://" + (scratch.path() / "index.html").string();
    const std::vector<std::string> options{"--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                                           "--user-data-dir=" + (scratch.path() / "profile").string()};
    auto arguments = options;
    arguments.insert(arguments.end(), {"--window-size=1200,2200", "--screenshot=" + picture, url});
    const auto shot = test::run_program(browser, arguments);
    const cv::Mat image = cv::imread(picture);
    ASSERT_FALSE(image.empty()) << shot.error;
    // The far half of the block is at the red end of the colour scale; nothing else of the page is, in such an area.
    int red = 0;
    for (int y = 0; y < image.rows; ++y)
        for (int x = 0; x < image.cols; ++x) {
            const cv::Vec3b c = image.at<cv::Vec3b>(y, x);
            red += c[2] > 90 && c[2] > 2 * c[1] && c[2] > 2 * c[0] ? 1 : 0;
        }
    EXPECT_GT(red, 3000) << "the viewer drew no gap";

    arguments = options;
    arguments.insert(arguments.end(), {"--dump-dom", url});
    const auto dom = test::run_program(browser, arguments);
    EXPECT_NE(dom.output.find("another tool"), std::string::npos) << "the table of answers is filled by the script";
    EXPECT_NE(dom.output.find("85.0 % to 94.0 %"), std::string::npos);
    EXPECT_NE(dom.output.find("Not in question: cut"), std::string::npos);
    EXPECT_NE(dom.output.find("extra_attachment: places that explain the gap"), std::string::npos);
}

}  // namespace
}  // namespace teres::tools
