// The whole verb, as a user runs it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

// A body that nothing holds falls g t^2 / 2, whatever it is made of; where it went is said.
TEST(SimulateCommand, FreeFallIsExactAndTold) {
    Case c = test::clamped_block({.frames = 5, .dt_s = 0.1, .quasi_static = false, .full_force_n = {0.0, 0.0, 0.0}});
    c.clamped.clear();
    c.gravity_m_s2 = {0.0, 0.0, -9.81};
    const test::ScratchFolder scratch;
    ASSERT_TRUE(write_case(c, scratch.path() / "case"));
    const std::string predicted = (scratch.path() / "points.csv").string();
    const test::Run run = test::run_teres({"simulate", (scratch.path() / "case").string(), "--predict", predicted});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const double fallen = 0.5 * 9.81 * 0.4 * 0.4;
    const auto points = read_positions(predicted, "point_id");
    ASSERT_TRUE(points) << points.error().text;
    std::size_t last = 0;
    for (const auto& sample : *points) {
        if (std::abs(sample.t_s - 0.4) > 1e-9) continue;
        for (const auto& rest : c.validation_rest)
            if (rest.id == sample.id) {
                EXPECT_NEAR(sample.position_m[2] - rest.position_m[2], -fallen, 1e-4 * fallen);
                ++last;
            }
    }
    EXPECT_EQ(last, c.validation_rest.size());
    EXPECT_THAT(run.error, testing::HasSubstr("times the body's size"));
}

}  // namespace
}  // namespace teres
