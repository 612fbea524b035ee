// `teres calibrate-springs`: sheets against closed forms, springs against the sheet, the command as a user runs it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/case/text_writer.h"
#include "tests/support/program.h"
#include "tools/springs/spring_sheet.h"

namespace teres {
namespace {

using ::testing::HasSubstr;
using tools::Sheet;
using tools::SheetMaterial;

Sheet coarse_sheet() {
    Sheet sheet;
    sheet.columns = 3;
    sheet.cells_per_column = 1;
    sheet.steps = 6;
    return sheet;
}

// Small strain: P = E e; incompressible neo-Hookean at l = 1.45 by hand: G (1.45 - 1/2.1025) = 0.9743757 G.
TEST(SheetMaterial, StressOfTheNeoHookeanSheetIsTheClosedForm) {
    const SheetMaterial m = tools::neo_hookean_sheet(6e6, 0.5);
    EXPECT_NEAR(m.stress_pa(1.0 + 1e-6), 6.0, 1e-4);
    EXPECT_NEAR(m.stress_pa(1.45), 0.9743757 * 2e6, 2.0);
    EXPECT_NEAR(m.youngs_modulus_pa(), 6e6, 1e-6);
}

// A curve computed from known coefficients gives them back.
TEST(SheetMaterial, FitOfACurveFindsItsCoefficients) {
    const test::ScratchFolder scratch;
    const SheetMaterial truth{"", 2e5, 4e5, 9e5, 0.48};
    TextWriter csv;
    csv.line("strain", "stress_pa");
    for (int i = 0; i <= 20; ++i) csv.line(0.025 * i, truth.stress_pa(1.0 + 0.025 * i));
    ASSERT_TRUE(write_text_file(scratch.path() / "c.csv", csv.text()));
    const auto m = tools::sheet_of_curve(scratch.path() / "c.csv", 0.48, 0.45);
    ASSERT_TRUE(m) << m.error().text;
    EXPECT_NEAR(m->c1_pa, 2e5, 1e-3 * 2e5);
    EXPECT_NEAR(m->c2_pa, 4e5, 1e-3 * 4e5);
    EXPECT_NEAR(m->c3_pa, 9e5, 1e-3 * 9e5);
}

// Springs alone, by hand: without diagonals the columns are bars in two layers, e = strain of each; load E A (g1 e + g2
// e^2
// + g3 e^3). The free layer's hold is 0.1 % of it.
TEST(SpringSheet, ColumnsWithoutDiagonalsStretchByTheirLaw) {
    const Sheet sheet = coarse_sheet();
    const tools::SpringSheet springs(sheet, 1e6, {1.0, -0.4, 0.3, 1e-9});
    const double e = 0.3, load = 1e6 * sheet.width_m * sheet.thickness_m * (e - 0.4 * e * e + 0.3 * e * e * e);
    Eigen::Matrix3Xd x = tools::edge_at_rest(sheet);
    ASSERT_TRUE(springs.equilibrium(load, x));
    const Eigen::Matrix3Xd X = tools::edge_at_rest(sheet);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(x(0, c) - X(0, c), e * sheet.length_m, 5e-3 * e * sheet.length_m);
}

// The filter recovers a law from the motion that this law makes.
TEST(SpringSheet, CalibrationFindsTheLawBehindAMotion) {
    const Sheet sheet = coarse_sheet();
    const SheetMaterial m = tools::neo_hookean_sheet(5e6, 0.48);
    const tools::SpringLaw law{0.8, -0.6, 0.5, 0.35};
    const tools::SpringSheet springs(sheet, m.youngs_modulus_pa(), law);
    tools::SheetPath path;
    Eigen::Matrix3Xd x = tools::edge_at_rest(sheet);
    for (int s = 1; s <= sheet.steps; ++s) {
        path.load_share.push_back(double(s) / sheet.steps);
        ASSERT_TRUE(springs.equilibrium(path.load_share.back() * sheet.load_n(m), x));
        path.edge_m.push_back(x);
    }
    const auto r = tools::calibrate(sheet, m, path);
    ASSERT_TRUE(r) << r.error().text;
    EXPECT_LT(r->max_error_mm, 0.5);  // the noise that the filter takes a spring to have
    EXPECT_NEAR(r->law.g1, law.g1, 0.1 * law.g1);
    EXPECT_NEAR(r->law.diagonal, law.diagonal, 0.05);
}

TEST(CalibrateSprings, MeetsACoarseSheetOfCalculix) {
    const test::ScratchFolder scratch;
    const auto json = scratch.path() / "springs.json", plot = scratch.path() / "springs.png";
    const test::Run r = test::run_teres({"calibrate-springs", "--youngs-modulus", "5e6", "--nodes", "3", "--cells", "1",
                                         "--steps", "6", "--json", json.string(), "--plot", plot.string()});
    if (r.error.find("program 'ccx' not found") != std::string::npos) GTEST_SKIP() << "SKIPPED LOUDLY: " << r.error;
    ASSERT_EQ(r.exit_code, 0) << r.error;
    std::ifstream in(json);
    const auto result = nlohmann::json::parse(in)["results"][0];
    EXPECT_LT(result["error_mm"]["mean"].get<double>(), 1.0);
    EXPECT_GT(result["error_mm"]["mean"].get<double>(), 0.0);
    EXPECT_GT(result["times_faster"].get<double>(), 1.0);
    // the sheet's own stiffness: uniaxial but for the clamped edge, which stiffens it by some per cent
    EXPECT_NEAR(result["load_n"].get<double>(), 0.9743757 * 5e6 / 2.96 * 40e-6, 1e-3);
    EXPECT_GT(std::filesystem::file_size(plot), 1000u);
}

TEST(CalibrateSprings, NamesWhatIsWrong) {
    const test::ScratchFolder scratch;
    const auto file = (scratch.path() / "curve.csv").string();
    EXPECT_EQ(test::run_teres({"calibrate-springs"}).exit_code, 2);
    EXPECT_EQ(test::run_teres({"calibrate-springs", "--youngs-modulus", "-5"}).exit_code, 2);
    const auto error_of = [&](const std::string& text) {
        EXPECT_TRUE(write_text_file(file, text));
        const test::Run r = test::run_teres({"calibrate-springs", "--curve", file});
        EXPECT_EQ(r.exit_code, 2);
        return r.error;
    };
    EXPECT_THAT(error_of("strain,stress_pa\n0,0\n0.1,1e5\n"), HasSubstr("2 rows, at least 4"));
    EXPECT_THAT(error_of("strain,stress_pa\n0,0\n10,1e5\n20,2e5\n45,9e5\n"), HasSubstr("strain = 10"));
    EXPECT_THAT(error_of("strain,stress_pa\n0,0\n0.1,9e5\n0.3,5e5\n0.45,1e5\n"), HasSubstr("does not rise at strain"));
}

}  // namespace
}  // namespace teres
