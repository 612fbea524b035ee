// Rates on synthetic innovations with known properties: white, correlated and heavy-tailed controls; sudden shifts.
#include "plugins/diagnosis/innovation_watch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <random>

namespace teres {
namespace {

constexpr std::size_t kMarkers = 14;
constexpr double kRate = 30.0, kSigma = 5e-4;

struct Stream {
    explicit Stream(unsigned seed, double correlation = 0.0, bool heavy = false)
        : generator(seed), phi(correlation), heavy_tail(heavy), memory(3 * kMarkers, 0.0) {}
    // shift(marker, axis) in sigma
    std::vector<MarkerInnovation> next(const std::function<double(std::size_t, std::size_t)>& shift) {
        std::vector<MarkerInnovation> frame(kMarkers);
        for (std::size_t m = 0; m < kMarkers; ++m) {
            frame[m] = {{0.0, 0.0, 0.0}, kSigma, true};
            for (std::size_t a = 0; a < 3; ++a) {
                double& e = memory[3 * m + a];
                const double noise = heavy_tail ? student(generator) / std::sqrt(2.0) : normal(generator);
                e = phi * e + std::sqrt(1.0 - phi * phi) * noise;
                frame[m].d_m[a] =
                    kSigma * (1.7 * e + 0.8 + shift(m, a));  // a filter that is too sure, and a standing bias
            }
        }
        return frame;
    }
    std::mt19937 generator;
    double phi;
    bool heavy_tail;
    std::vector<double> memory;
    std::normal_distribution<double> normal;
    std::student_t_distribution<double> student{4.0};
};

std::int64_t stamp(int frame, double rate_hz = kRate) {
    return std::llround(1e6 * frame / rate_hz);
}

// Alarms (rising edges) in so many hours without any shift.
int false_alarms(Stream stream, double hours, double rate_hz = kRate) {
    InnovationWatch watch(kMarkers, {});
    int count = 0;
    bool before = false;
    for (int f = 0; f < static_cast<int>(hours * 3600.0 * rate_hz); ++f) {
        const bool alarm = watch.update(stamp(f, rate_hz), stream.next([](auto, auto) { return 0.0; })).alarm;
        count += alarm && !before ? 1 : 0;
        before = alarm;
    }
    return count;
}

TEST(InnovationWatch, AtMostOneFalseAlarmAnHour) {
    EXPECT_LE(false_alarms(Stream(1), 2.0), 2);
    EXPECT_LE(false_alarms(Stream(2, 0.7), 2.0), 2) << "correlated in time";
    EXPECT_LE(false_alarms(Stream(3, 0.0, true), 2.0), 2) << "heavy tails (Student, 4 degrees of freedom)";
    EXPECT_LE(false_alarms(Stream(4, 0.7), 4.0, 5.0), 4) << "five frames a second";
    EXPECT_LE(false_alarms(Stream(5, 0.0, true), 4.0, 5.0), 4) << "five frames a second, heavy tails";
}

// What few frames say of the spread and the correlation is itself off: each start counts as much as the hour after it.
TEST(InnovationWatch, StartsRaiseNoMoreFalseAlarmsThanTheHoursAfterThem) {
    const auto alarms_in_five_hours_of_starts = [](double correlation) {
        int count = 0;
        for (unsigned start = 1; start <= 300; ++start)
            count += false_alarms(Stream(start, correlation), 1.0 / 60.0, 5.0);
        return count;
    };
    const int white = alarms_in_five_hours_of_starts(0.0), correlated = alarms_in_five_hours_of_starts(0.7);
    std::printf("alarms in 300 starts of a minute: %d white, %d correlated by 0.7\n", white, correlated);
    EXPECT_LE(white, 1);
    EXPECT_LE(correlated, 5);
}

struct Event {
    double delay_s;
    GapKind kind;
    double onset_error_s;
    std::size_t strongest;
};
Event event(unsigned seed, const std::function<double(std::size_t, std::size_t)>& shift) {
    Stream stream(seed);
    InnovationWatch watch(kMarkers, {});
    constexpr int kOnset = 900;
    for (int f = 0; f < kOnset + 90; ++f) {
        const auto& state = watch.update(
            stamp(f), stream.next([&](std::size_t m, std::size_t a) { return f >= kOnset ? shift(m, a) : 0.0; }));
        if (!state.alarm || f < kOnset) continue;
        const auto most = std::max_element(state.marker_statistic.begin(), state.marker_statistic.end());
        return {(f - kOnset + 1) / kRate, state.kind, 1e-6 * static_cast<double>(state.onset_us - stamp(kOnset)),
                static_cast<std::size_t>(most - state.marker_statistic.begin())};
    }
    return {1e9, GapKind::kNone, 1e9, 0};
}

TEST(InnovationWatch, SlippedMarkerIsASensorAlarmWithinASecond) {
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const Event e = event(seed, [](std::size_t m, std::size_t a) { return m == 6 && a == 1 ? 6.0 : 0.0; });
        EXPECT_LT(e.delay_s, 1.0) << seed;
        EXPECT_EQ(e.kind, GapKind::kSensor) << seed;
        EXPECT_EQ(e.strongest, 6u) << seed;
        EXPECT_NEAR(e.onset_error_s, 0.0, 0.2) << seed;
    }
}

TEST(InnovationWatch, MovedCameraIsSensorMovedBodyIsMechanics) {
    int sensor = 0, mechanics = 0;
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const Event camera = event(seed, [](std::size_t, std::size_t a) { return a == 2 ? 6.0 : 0.0; });
        EXPECT_LT(camera.delay_s, 1.0);
        sensor += camera.kind == GapKind::kSensor ? 1 : 0;
        const Event body = event(seed, [](std::size_t m, std::size_t a) {
            return m < 5 ? (a == 2 ? 7.0 : -3.0) * (1.0 - 0.15 * static_cast<double>(m)) : 0.0;
        });
        EXPECT_LT(body.delay_s, 1.0);
        mechanics += body.kind == GapKind::kMechanics ? 1 : 0;
    }
    EXPECT_GE(sensor, 18);
    EXPECT_GE(mechanics, 18);
}

// A push that many markers feel a little, none of them much: seen by all of them together, and yet the body.
TEST(InnovationWatch, ABodyThatMovesALittleEverywhereIsMechanics) {
    int mechanics = 0;
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const Event push = event(seed, [](std::size_t m, std::size_t a) {
            return 3.2 * std::cos(1.3 * static_cast<double>(m) + 2.0 * static_cast<double>(a));
        });
        EXPECT_LT(push.delay_s, 1.5) << seed;
        mechanics += push.kind == GapKind::kMechanics ? 1 : 0;
    }
    EXPECT_GE(mechanics, 18);
}

// A registration that is off when the service starts is no level to get used to.
TEST(InnovationWatch, WhatIsThereFromTheStartAlarmsWithinASecond) {
    const auto first_alarm = [](const std::function<double(std::size_t, std::size_t)>& shift) {
        Stream stream(31);
        InnovationWatch watch(kMarkers, {});
        for (int f = 0; f < 30 && !watch.state().alarm; ++f) watch.update(stamp(f), stream.next(shift));
        return watch.state();
    };
    const GapState camera = first_alarm([](auto, std::size_t a) { return a == 1 ? 12.0 : 0.0; });
    EXPECT_TRUE(camera.alarm);
    EXPECT_EQ(camera.kind, GapKind::kSensor);
    EXPECT_LT(camera.onset_us, 100'000);
    const GapState body = first_alarm([](std::size_t m, std::size_t) { return m % 2 == 0 ? 8.0 : -8.0; });
    EXPECT_TRUE(body.alarm);
    EXPECT_EQ(body.kind, GapKind::kMechanics);
    Stream stream(32);
    InnovationWatch watch(kMarkers, {});
    for (int f = 0; f < 900; ++f) {  // stands for 20 s, and is mended
        watch.update(stamp(f), stream.next([&](auto, std::size_t a) { return f < 600 && a == 1 ? 12.0 : 0.0; }));
        EXPECT_TRUE(f < 30 || f >= 600 || watch.state().alarm) << f;
        EXPECT_TRUE(f < 630 || !watch.state().alarm) << f;
    }
    EXPECT_FALSE(first_alarm([](auto, auto) { return 0.0; }).alarm) << "a filter too sure by 1.7, and a standing bias";
}

// Five frames a second: every marker jumps its own way by 8 sigma, and the filter has followed after half a second. The
// axes alone, each of which counts 2.75 deviations at most, would need four frames of one direction.
TEST(InnovationWatch, AJumpOfManyMarkersIsSeenInTwoFramesButNotInOne) {
    const auto alarm_after_s = [](int frames_long) {
        Stream stream(21);
        InnovationWatch watch(kMarkers, {});
        for (int f = 0; f < 120; ++f) {
            const bool jumps = f >= 60 && f < 60 + frames_long;
            const auto shift = [&](std::size_t m, std::size_t a) {
                return !jumps ? 0.0 : ((3 * m + a) % 2 == 0 ? 8.0 : -8.0) * (f % 2 == 0 ? 1.0 : -1.0);
            };
            if (watch.update(200'000LL * f, stream.next(shift)).alarm) return 0.2 * (f - 60 + 1);
        }
        return 1e9;
    };
    EXPECT_EQ(alarm_after_s(1), 1e9) << "a flash";
    EXPECT_NEAR(alarm_after_s(2), 0.4, 1e-9);
    EXPECT_NEAR(alarm_after_s(5), 0.4, 1e-9);
}

TEST(InnovationWatch, BoundFollowsTheRunLength) {
    // Siegmund: ARL of one one-sided CUSUM, k = 1, h = 3: (e^{2 x 4.166} - 8.332 - 1)/2 = 2077 frames
    std::mt19937 generator(5);
    std::normal_distribution<double> normal;
    double total = 0.0;
    constexpr int kRuns = 400;
    for (int run = 0; run < kRuns; ++run)
        for (double g = 0.0; g < 3.0; total += 1.0) g = std::max(0.0, g + normal(generator) - 1.0);
    EXPECT_NEAR(total / kRuns, 2077.0, 350.0);
    // ... and the bound is that formula turned round: 2 channels' worth of it in 2077/30 s
    EXPECT_NEAR(cusum_bound(1.0, 30.0, 2.0 * 2077.0 / 30.0 / 2.0 / 2.0 * 2.0, 1), 3.0 + std::log(2.0) / 2.0, 0.4);
}

// While a load pushes elsewhere the model's error differs, within what the filter expects of it (1 sigma).
TEST(InnovationWatch, ACalmBeginningPromisesNothing) {
    InnovationWatch watch(kMarkers, {});
    std::mt19937 generator(4);
    std::normal_distribution<double> normal;
    for (int f = 0; f < 3600; ++f) {
        std::vector<MarkerInnovation> frame(kMarkers);
        const double load = f < 300 ? 0.0 : 1.5 * std::sin(2.0 * M_PI * (f - 300) / 240.0);
        for (std::size_t m = 0; m < kMarkers; ++m) {
            frame[m] = {{0.0, 0.0, 0.0}, kSigma, true};
            for (double& d : frame[m].d_m) d = kSigma * (0.3 * normal(generator) + (m % 3 == 0 ? load : 0.0));
        }
        EXPECT_FALSE(watch.update(stamp(f), frame).alarm) << "frame " << f;
    }
}

TEST(InnovationWatch, OnsetIsNotBeforeTheLevelWasLearnt) {
    Stream stream(11);
    InnovationWatch watch(kMarkers, {});
    const int learnt = static_cast<int>(InnovationWatchOptions{}.learning_s * kRate);  // the first frame after it
    for (int f = 0; f < learnt + 60 && !watch.state().alarm; ++f)
        watch.update(stamp(f),
                     stream.next([&](std::size_t m, std::size_t) { return m == 3 && f >= learnt ? 9.0 : 0.0; }));
    ASSERT_TRUE(watch.state().alarm);
    EXPECT_NEAR(1e-6 * static_cast<double>(watch.state().onset_us), InnovationWatchOptions{}.learning_s, 0.2);
}

TEST(InnovationWatch, LostMarkersAndStrayStampsDoNoHarm) {
    InnovationWatch watch(kMarkers, {});
    Stream stream(9);
    for (int f = 0; f < 600; ++f) {
        auto frame = stream.next([](auto, auto) { return 0.0; });
        if (f % 7 == 0) frame[3].seen = false;
        if (f % 11 == 0) frame[4].d_m[0] = NAN;
        watch.update(stamp(f), frame);
        watch.update(stamp(f) - 5000, frame);  // goes backwards: ignored
    }
    EXPECT_FALSE(watch.state().alarm);
    EXPECT_TRUE(std::isfinite(watch.state().statistic));
}

}  // namespace
}  // namespace teres
