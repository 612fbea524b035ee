// What lies beside the span of a motion in time, and how it is compared: by hand.
#include "plugins/diagnosis/motion_span.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "plugins/diagnosis/error_floor.h"

namespace teres {
namespace {

constexpr Eigen::Index kFrames = 40, kChannels = 6;

double wave(Eigen::Index frame, double periods) {
    return std::sin(2.0 * std::numbers::pi * periods * static_cast<double>(frame) / static_cast<double>(kFrames));
}

// Every channel follows its own share of two loads.
Eigen::VectorXd course(const std::function<double(Eigen::Index frame, Eigen::Index channel)>& value) {
    Eigen::VectorXd out(kFrames * kChannels);
    for (Eigen::Index f = 0; f < kFrames; ++f)
        for (Eigen::Index c = 0; c < kChannels; ++c) out(f * kChannels + c) = value(f, c);
    return out;
}
Eigen::VectorXd two_loads() {
    return course([](Eigen::Index f, Eigen::Index c) {
        return 0.01 * static_cast<double>(c) + 0.002 * static_cast<double>(c + 1) * wave(f, 2.0) +
               0.001 * static_cast<double>(5 - c) * wave(f, 3.0);
    });
}
std::vector<Eigen::Index> all_rows() {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index k = 0; k < kFrames * kChannels; ++k) rows.push_back(k);
    return rows;
}

TEST(MotionSpan, HoldsAConstantAndTheCoursesOfTheLoads) {
    const MotionSpan span(two_loads(), kChannels, all_rows());
    EXPECT_EQ(span.degrees(), static_cast<double>((kFrames - 3) * kChannels));
    const Eigen::VectorXd error = course(
        [](Eigen::Index f, Eigen::Index c) { return 2.0 - wave(f, 3.0) + static_cast<double>(c) * wave(f, 2.0); });
    EXPECT_NEAR(span.beside(error), 0.0, 1e-9);
}

TEST(MotionSpan, ACourseOfItsOwnLiesBesideIt) {
    const MotionSpan span(two_loads(), kChannels, all_rows());
    const Eigen::VectorXd heart =
        course([](Eigen::Index f, Eigen::Index c) { return c == 1 ? 3.0 * wave(f, 13.0) : 0.0; });
    EXPECT_NEAR(span.beside(heart), 9.0 * kFrames / 2.0, 1e-9);
    const Eigen::VectorXd both = heart + course([](Eigen::Index f, Eigen::Index) { return 5.0 * wave(f, 2.0) - 1.0; });
    EXPECT_NEAR(span.beside(both), 9.0 * kFrames / 2.0, 1e-9);
}

// A marker that is lost for a while: what is left of its span is still taken off, and nothing of the others.
TEST(MotionSpan, CountsOnlyTheFramesThatAreSeen) {
    std::vector<Eigen::Index> rows;
    for (const Eigen::Index row : all_rows())
        if (row % kChannels != 2 || row / kChannels < 2 || row / kChannels >= 30) rows.push_back(row);
    const MotionSpan span(two_loads(), kChannels, rows);
    EXPECT_EQ(span.degrees(), static_cast<double>(rows.size()) - 3.0 * kChannels);
    const Eigen::VectorXd all = course([](Eigen::Index f, Eigen::Index) { return 1.0 + wave(f, 2.0) + wave(f, 3.0); });
    EXPECT_NEAR(span.beside(all(rows)), 0.0, 1e-9);
}

// Noise 10, 6 of it beside; model 4, 1 of it beside.
TEST(ErrorFloor, ComparesInsideAndBesideOnTheirOwn) {
    const ErrorFloor floor{.noise = 10.0, .model = 4.0, .noise_beside = 6.0, .model_beside = 1.0};
    EXPECT_NEAR(floor.log_above({19.0, 12.0}), std::log(7.0 - 4.0 + 4.0) + std::log(12.0 - 6.0 + 1.0), 1e-12);
    EXPECT_NEAR(floor.log_above({7.0, 5.0}), std::log(4.0) + std::log(1.0), 1e-12) << "no less than the floor";
    const ErrorFloor together{.noise = 10.0, .model = 4.0};
    EXPECT_NEAR(together.log_above({19.0, 12.0}), std::log(13.0), 1e-12);

    // 70 % of the model's error and 10 % of what is beyond: inside 6.8 + 0.02, beside 6.7 + 0.53.
    const Left rest = floor.reached({19.0, 12.0}, 0.7, 0.1);
    EXPECT_NEAR(rest.inside(), 6.8 + 0.1 * 0.2, 1e-12);
    EXPECT_NEAR(rest.beside, 6.7 + 0.1 * 5.3, 1e-12);
    // Two thirds of the 9 above the noise are 6: of the 6 beside, 4.
    EXPECT_NEAR(floor.scaled({19.0, 12.0}, 16.0).beside, 10.0, 1e-12);
}

// Inside 4 are noise and 4 the model's error, beside it 6 and 1: neither makes up for the other.
TEST(ErrorFloor, ExplainsNothingBesideTheMotionByWhatIsLittleInside) {
    const ErrorFloor floor{.noise = 10.0, .model = 4.0, .noise_beside = 6.0, .model_beside = 1.0};
    EXPECT_TRUE(floor.explains({14.9, 7.0}));
    EXPECT_FALSE(floor.explains({11.5, 8.5}));
    EXPECT_NEAR(floor.beyond({11.5, 8.5}).beside, 1.5, 1e-12);
    EXPECT_NEAR(floor.beyond({11.5, 8.5}).inside(), 0.0, 1e-12);
    const ErrorFloor together{.noise = 10.0, .model = 4.0};
    EXPECT_TRUE(together.explains({11.5, 8.5}));
    EXPECT_NEAR(together.beyond({16.0, 8.5}).cost, 2.0, 1e-12);
}

// Markers that scatter half as much again leave 2.25 times the noise, 12.5 more, 7.5 of it beside.
TEST(ErrorFloor, NoiseBeyondTheStatedOneIsTakenOff) {
    const ErrorFloor floor{.noise = 10.0, .model = 4.0, .noise_beside = 6.0, .model_beside = 1.0};
    const Left left = floor.beside_noise({30.0, 15.0}, 1.5);
    EXPECT_NEAR(left.cost, 17.5, 1e-12);
    EXPECT_NEAR(left.beside, 7.5, 1e-12);
    const ErrorFloor noisier = floor.with_noise(1.5);
    EXPECT_NEAR(floor.log_above(left), noisier.log_above({30.0, 15.0}), 1e-12);
}

TEST(ErrorFloor, SplitsByTheShareThatIsFree) {
    const Calibration c;
    const ErrorFloor floor = split_floor({.noise = 10.0, .model = 4.0}, 0.6, c);
    EXPECT_NEAR(floor.noise_beside, 6.0, 1e-12);
    EXPECT_NEAR(floor.model_beside, c.beside_model * 4.0 + c.beside_noise * 6.0, 1e-12);
    EXPECT_TRUE(floor.split());
    EXPECT_FALSE((ErrorFloor{10.0, 4.0}).split());
}

}  // namespace
}  // namespace teres
