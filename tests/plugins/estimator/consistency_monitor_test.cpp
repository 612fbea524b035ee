#include "plugins/estimator/consistency_monitor.h"

#include <gtest/gtest.h>

#include <random>

using teres::ConsistencyMonitor;

namespace {

constexpr Eigen::Index kDof = 60;

double draw_nis(std::mt19937& engine, double level) {
    std::chi_squared_distribution<double> chi2(static_cast<double>(kDof));
    return level * chi2(engine);
}

}  // namespace

TEST(ConsistencyMonitor, StaysQuietOnConsistentInnovations) {
    std::mt19937 engine(1);
    ConsistencyMonitor monitor;
    int alarms = 0;
    for (int i = 0; i < 5000; ++i) alarms += monitor.add(draw_nis(engine, 1.0), kDof);
    EXPECT_EQ(alarms, 0);
}

// A constant model error raises the level for good: no reason to open up again and again.
TEST(ConsistencyMonitor, LearnsTheLevelOfTheModel) {
    for (double level : {0.1, 2.5}) {
        std::mt19937 engine(2);
        ConsistencyMonitor monitor;
        int late_alarms = 0;
        for (int i = 0; i < 1000; ++i) late_alarms += monitor.add(draw_nis(engine, level), kDof) && i > 50;
        EXPECT_EQ(late_alarms, 0) << level;
        EXPECT_NEAR(monitor.baseline(), level, 0.1 * level);
    }
}

TEST(ConsistencyMonitor, AnswersAJumpWithinTwoFrames) {
    for (double level : {0.2, 1.0, 2.0}) {
        std::mt19937 engine(3);
        ConsistencyMonitor monitor;
        for (int i = 0; i < 200; ++i) monitor.add(draw_nis(engine, level), kDof);
        const bool first = monitor.add(draw_nis(engine, 8.0 * level), kDof);
        const bool second = monitor.add(draw_nis(engine, 8.0 * level), kDof);
        EXPECT_TRUE(first || second) << level;
    }
}

TEST(ConsistencyMonitor, IgnoresFramesWithoutMarkers) {
    ConsistencyMonitor monitor;
    EXPECT_FALSE(monitor.add(1e9, 0));
    EXPECT_EQ(monitor.baseline(), 1.0);
}
