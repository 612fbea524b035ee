// What a hypothesis leaves on the frames after those that are fitted, by hand.
#include "plugins/diagnosis/outlook.h"

#include <gtest/gtest.h>

#include "plugins/diagnosis/effect_table.h"
#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4, kOffset = 1e-3;

// 20 of 60 frames are fitted: the next 20 tell, the last 20 are left for the report.
struct LongRecording {
    test::ToyBody beginning, whole;
    test::ToyCamera camera;
    EffectTable effects{whole, &camera, {}};
    std::vector<double> observed;
    Calibration calibration;

    LongRecording() {
        beginning.frames = 20;
        beginning.inertia = whole.inertia = beginning.known_supports = whole.known_supports = true;
        observed = whole.motion({{}, {}});
        calibration.white_share = 0.0;
    }
    GapRecording recording() const {
        GapRecording r{"toy", const_cast<test::ToyBody*>(&beginning), &camera, {}, kNoise, 1};
        r.whole_mechanics = const_cast<test::ToyBody*>(&whole);
        r.whole_sensors = &camera;
        r.whole_observed_m = observed;
        return r;
    }
    std::unique_ptr<Outlook> outlook() const {
        auto made = Outlook::make(recording(), effects, calibration);
        EXPECT_TRUE(made) << made.error().text;
        return made ? std::move(*made) : nullptr;
    }
};

TEST(Outlook, MeansFittedAndLaterFrames) {
    LongRecording toy;
    const double variance = kNoise * kNoise + toy.calibration.white_floor_m * toy.calibration.white_floor_m;
    for (std::size_t f = 30; f < 60; ++f)  // half of the later frames; what is reported on does not count
        for (std::size_t m = 0; m < test::kToyMarkers; ++m) toy.observed[3 * (f * test::kToyMarkers + m)] += kOffset;
    toy.observed[3 * 25 * test::kToyMarkers] = NAN;  // one number of 20 frames is lost
    const auto outlook = toy.outlook();
    ASSERT_NE(outlook, nullptr);
    EXPECT_EQ(outlook->end_frame(), 40u);
    const double numbers = 3.0 * test::kToyMarkers * 20.0 - 1.0,
                 sum = 10.0 * test::kToyMarkers * kOffset * kOffset / variance;
    EXPECT_NEAR(outlook->later({}, 100.0, 600), 0.5 * (sum * 600.0 / numbers - 100.0), 1e-9 * sum);
}

TEST(Outlook, AnExactModelLeavesNothing) {
    EXPECT_DOUBLE_EQ(LongRecording().outlook()->later({}, 80.0, 600), -40.0);
}

TEST(Outlook, AModelThatCannotBeFollowedIsOut) {
    LongRecording toy;
    toy.whole.converges = false;
    EXPECT_GT(toy.outlook()->later({}, 100.0, 600), 1e8);
}

// A rough look is one about the trajectory on which it stands, whatever was looked at in between.
TEST(Outlook, ARoughLookStandsWhereItWasPut) {
    LongRecording toy;
    toy.beginning.known_supports = toy.whole.known_supports = false;
    toy.whole.other_branch_m = kOffset;
    const Assumption nominal{{250.0, 150.0}, {}}, other{{260.0, 170.0}, {}};
    toy.observed = toy.whole.motion({other.theta, {}});
    const auto outlook = toy.outlook();
    ASSERT_NE(outlook, nullptr);
    const double exact = -40.0, variance = kNoise * kNoise + std::pow(toy.calibration.white_floor_m, 2),
                 off = 0.5 * (kOffset * kOffset / variance * 600.0 - 80.0);
    EXPECT_DOUBLE_EQ(outlook->later(other, 80.0, 600, true), exact);  // it stands nowhere yet
    outlook->stand_on(nominal);
    EXPECT_NEAR(outlook->later(other, 80.0, 600, true), off, 1e-9 * off);
    EXPECT_DOUBLE_EQ(outlook->later(other, 80.0, 600), exact);
    EXPECT_NEAR(outlook->later(other, 80.0, 600, true), off, 1e-9 * off);
    EXPECT_NEAR(outlook->later(nominal, 80.0, 600, true), outlook->later(nominal, 80.0, 600), 1e-9);
}

TEST(Outlook, OfAShortRecordingThereIsNone) {
    const LongRecording toy;
    GapRecording recording = toy.recording();
    recording.whole_mechanics = nullptr;
    const auto made = Outlook::make(recording, toy.effects, toy.calibration);
    ASSERT_TRUE(made);
    EXPECT_EQ(*made, nullptr);
}

}  // namespace
}  // namespace teres
