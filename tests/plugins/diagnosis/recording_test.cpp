// What is held out, by hand.
#include "plugins/diagnosis/recording.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

// Marker m is (m * 7 mod 10) mm off in every frame.
Recording ten_markers() {
    Recording r;
    r.num_markers = 10;
    r.num_frames = 12;
    r.observed.setZero(3 * 10 * 12);
    for (Eigen::Index row = 0; row < r.observed.size(); ++row)
        r.observed(row) = 1e-3 * static_cast<double>(r.marker_of(row) * 7 % 10);
    return r;
}

TEST(Recording, HoldsOutMarkersOfMiddlingGap) {
    Recording r = ten_markers();
    r.observed(3 * 4) = NAN;
    r.hold_out_markers(Eigen::VectorXd::Zero(r.observed.size()));
    // By gap, largest first: marker 7 (9 mm), 4 (8), 1 (7), 8 (6), 5 (5), 2 (4), 9 (3), 6 (2), 3 (1), 0; every
    // fifth from the third: 1 and 6.
    EXPECT_EQ(r.held_markers, (std::vector<std::int32_t>{1, 6}));
    EXPECT_EQ(r.held_rows.size(), 2u * 3 * 12);
    EXPECT_EQ(r.fit_rows.size(), 8u * 3 * 12 - 1) << "one entry is lost";
    EXPECT_TRUE(std::all_of(r.held_rows.begin(), r.held_rows.end(),
                            [&](Eigen::Index row) { return r.marker_of(row) == 1 || r.marker_of(row) == 6; }));
}

TEST(Recording, HoldsOutTheLastSixthOfTheFrames) {
    Recording r = ten_markers();
    r.hold_out_frames();
    EXPECT_EQ(r.first_held_frame, 10u);
    EXPECT_EQ(r.held_rows.size(), 2u * 30);
    EXPECT_EQ(r.fit_rows.size(), 10u * 30);
    EXPECT_TRUE(r.held_markers.empty());
}

}  // namespace
}  // namespace teres
