// The peer's recorded filter runs (outside data): our modules with its ingredients give its rows.
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/test_data.h"
#include "tools/peer_bench/report.h"

namespace teres::peer {
namespace {

FolderReport run(const std::filesystem::path& folder, int rows) {
    BenchOptions options;
    options.threads = 2;
    options.max_rows = rows;
    auto report = run_folder(folder, options);
    EXPECT_TRUE(report.has_value()) << (report ? "" : report.error().text);
    return report ? *report : FolderReport{};
}

// TERES_PEER_ROWS=0 (the test labelled `long`): all rows.
int rows(int quick) {
    const char* given = std::getenv("TERES_PEER_ROWS");
    return given != nullptr ? std::atoi(given) : quick;
}

void expect_recorded(const FolderReport& report, int all, double bound) {
    const int expected = rows(1) == 0 ? all : report.rows;
    EXPECT_EQ(report.rows, expected);
    EXPECT_GT(report.rows, 100);
    EXPECT_LT(report.max_relative_difference, bound) << report.worst_parameter << " at row " << report.worst_row;
}

// Bounds: ten times what this code reaches on all rows (1.2e-5, 1.7e-8, 7.8e-5), at most the 1e-3 that is
// promised.
TEST(PeerRun, CylinderTwoModuliGivesRecordedState) {
    TERES_REQUIRE_DATA(folder, "peer/cylinder_two_moduli");
    expect_recorded(run(folder, rows(600)), 2500, 1.2e-4);
}

TEST(PeerRun, LiverCutLigamentGivesRecordedState) {
    TERES_REQUIRE_DATA(folder, "peer/liver_cut_ligament");
    expect_recorded(run(folder, rows(300)), 2700, 1e-6);
}

TEST(PeerRun, LiverPolynomialSpringsGivesRecordedState) {
    TERES_REQUIRE_DATA(folder, "peer/liver_polynomial_springs");
    expect_recorded(run(folder, rows(600)), 8000, 1e-3);
}

TEST(PeerRun, FirstRowIsTheMeanOfClampedSigmaPoints) {
    TERES_REQUIRE_DATA(folder, "peer/liver_polynomial_springs");
    const auto report = run(folder, 1);
    ASSERT_EQ(report.final.size(), 6u);
    const double expected[] = {1124.55748629, 1165.90457331, 1613.19687489, 1195.36073581, 1202.33208825, 1635.7980361};
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(report.final[i].mean, expected[i], 1e-7);
    EXPECT_NEAR(report.final[0].stdev * report.final[0].stdev, 627096.404814, 1e-4);
}

TEST(PeerRun, ThreadsDoNotChangeTheResult) {
    TERES_REQUIRE_DATA(folder, "peer/liver_cut_ligament");
    BenchOptions options;
    options.max_rows = 20;
    options.threads = 1;
    const auto one = run_folder(folder, options);
    options.threads = 3;
    const auto three = run_folder(folder, options);
    ASSERT_TRUE(one && three);
    for (std::size_t i = 0; i < one->final.size(); ++i) EXPECT_EQ(one->final[i].mean, three->final[i].mean);
}

OwnReport run_own(const std::filesystem::path& folder, int rows) {
    BenchOptions options;
    options.own_only = true;
    options.threads = 2;
    options.max_rows = rows;
    auto report = run_folder(folder, options);
    EXPECT_TRUE(report && report->own) << (report ? "" : report.error().text);
    return report && report->own ? *report->own : OwnReport{};
}

TEST(OwnFilter, CylinderIsCloserToTheTruthThanThePeerAndHonest) {
    TERES_REQUIRE_DATA(folder, "peer/cylinder_two_moduli");
    const OwnReport own = run_own(folder, rows(600));
    ASSERT_EQ(own.sigma_distance.size(), 2u);
    EXPECT_LT(own.own_error, 0.01 * own.peer_error);
    for (const double distance : own.sigma_distance) EXPECT_LT(distance, 3.0);
}

// The cut is at step 1201; the peer needs 2.8 s, and its third variance ends at exactly 0.
TEST(OwnFilter, ReleasedSpringIsSeenWithinHalfASecondAndStaysAwake) {
    TERES_REQUIRE_DATA(folder, "peer/liver_cut_ligament");
    const OwnReport own = run_own(folder, rows(1260) == 0 ? 0 : 1260);
    ASSERT_EQ(own.releases.size(), 1u);
    EXPECT_EQ(own.releases[0].name, "k2");
    ASSERT_TRUE(own.releases[0].own_delay_s.has_value());
    EXPECT_LT(*own.releases[0].own_delay_s, 0.5);
    EXPECT_GT(own.smallest_stdev, 1e-6);
    EXPECT_EQ(own.refused_points, (std::vector<int>{7, 8, 9}));
    if (rows(1) == 0) {
        EXPECT_LT(own.own_error, own.peer_error);
    }
}

}  // namespace
}  // namespace teres::peer
