// The recovery state machine alone, on made-up times.
#include "drivers/device/device_watch.h"

#include <gtest/gtest.h>

#include <vector>

namespace teres {
namespace {

using State = DeviceState;
using Step = RecoveryStep;

struct Timed {
    std::int64_t ms;
    Step step;
    bool operator==(const Timed&) const = default;
};

// Steps told from `from_ms` to `to_ms`, asked every 10 ms.
std::vector<Timed> steps(DeviceWatch& watch, std::int64_t from_ms, std::int64_t to_ms) {
    std::vector<Timed> told;
    for (std::int64_t ms = from_ms; ms <= to_ms; ms += 10)
        if (const Step step = watch.due(1000 * ms); step != Step::kNone) told.push_back({ms, step});
    return told;
}

DeviceWatch streaming() {
    DeviceWatch watch({250'000, 1'000'000, 3'000'000});
    watch.found(0);
    watch.data(0);
    return watch;
}

TEST(DeviceWatch, SilenceGoesFromStaleThroughEveryStepToAdvice) {
    DeviceWatch watch = streaming();
    EXPECT_TRUE(steps(watch, 0, 240).empty());
    EXPECT_EQ(watch.state(), State::kStreaming);
    EXPECT_TRUE(steps(watch, 250, 1240).empty());
    EXPECT_EQ(watch.state(), State::kStale);
    EXPECT_EQ(steps(watch, 1250, 12000), (std::vector<Timed>{{1250, Step::kRestartStream},
                                                             {2250, Step::kReopen},
                                                             {3250, Step::kReset},
                                                             {4250, Step::kAdvisePowerCycle},
                                                             {7250, Step::kReopen},
                                                             {10250, Step::kReset}}));
    EXPECT_EQ(watch.state(), State::kRecovering);
}

TEST(DeviceWatch, DataEndsTheRecoveryAndTheNextStartsAtTheFirstStep) {
    DeviceWatch watch = streaming();
    steps(watch, 0, 3000);
    watch.data(3'000'000);
    EXPECT_EQ(watch.state(), State::kStreaming);
    EXPECT_EQ(watch.recoveries(), 1);
    EXPECT_EQ(steps(watch, 3000, 4250), (std::vector<Timed>{{4250, Step::kRestartStream}}));
}

TEST(DeviceWatch, ErrorTakesTheFirstStepAtOnceAndFurtherOnesKeepThePace) {
    DeviceWatch watch = streaming();
    watch.error(10'000);
    EXPECT_EQ(watch.due(10'000), Step::kRestartStream);
    watch.error(20'000);
    EXPECT_EQ(watch.due(20'000), Step::kNone);
    EXPECT_EQ(watch.due(1'010'000), Step::kReopen);
}

TEST(DeviceWatch, DamagedFramesInARowAreAnError) {
    DeviceWatch watch = streaming();
    for (int i = 0; i + 1 < DeviceWatch::kMaxDamaged; ++i) watch.damaged(1000);
    EXPECT_EQ(watch.state(), State::kStreaming);
    watch.data(1000);
    for (int i = 0; i < DeviceWatch::kMaxDamaged; ++i) watch.damaged(2000);
    EXPECT_EQ(watch.due(2000), Step::kRestartStream);
}

// A camera that another program uses must not be reset under its hands.
TEST(DeviceWatch, WhoRefusesIsOnlyAskedAgain) {
    DeviceWatch watch({250'000, 1'000'000, 3'000'000});
    watch.found(0);
    watch.refused(0);
    for (const Timed& t : steps(watch, 0, 10000)) {
        EXPECT_EQ(t.step, Step::kReopen);
        watch.refused(1000 * t.ms);
    }
    EXPECT_EQ(watch.state(), State::kRecovering);
    watch.data(11'000'000);
    EXPECT_EQ(watch.state(), State::kStreaming);
}

TEST(DeviceWatch, GoneIsAbsentUntilFoundAndResetStepsGoOn) {
    DeviceWatch watch = streaming();
    watch.gone();
    EXPECT_TRUE(steps(watch, 0, 10000).empty());
    EXPECT_EQ(watch.state(), State::kAbsent);
    watch.error(10'000'000);
    watch.found(10'000'000);
    EXPECT_EQ(watch.state(), State::kRecovering);
    EXPECT_EQ(steps(watch, 10000, 13000), (std::vector<Timed>{{13000, Step::kRestartStream}}));
    watch.data(13'100'000);
    EXPECT_EQ(watch.recoveries(), 1);
    watch.gone();
    EXPECT_STREQ(state_word(watch.state()), "absent");
}

}  // namespace
}  // namespace teres
