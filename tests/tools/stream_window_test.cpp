// What the bus said becomes a case folder that reads back.
#include "tools/stream_window.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres::tools {
namespace {

constexpr std::int64_t kStart = 5'000'000'000;  // [us], a clock that began long ago

markers_t markers_at(const Case& c, std::int64_t us, std::size_t count) {
    markers_t m{};
    m.header.capture_stamp_us = us;
    for (std::size_t k = 0; k < count; ++k) {
        m.marker_id.push_back(c.markers[k].id);
        m.x_m.push_back(c.markers[k].position_m[0] + 1e-9 * static_cast<double>(us - kStart));
        m.y_m.push_back(c.markers[k].position_m[1]);
        m.z_m.push_back(c.markers[k].position_m[2]);
    }
    return m;
}

tool_loads_t loads_at(const Case& c, std::int64_t us, double force_n) {
    tool_loads_t l{};
    l.header.capture_stamp_us = us;
    l.region = {"of another case", c.load_regions[0].name};
    l.fx_n = {9.0, force_n};
    l.fy_n = l.fz_n = {0.0, 0.0};
    return l;
}

TEST(StreamWindow, BecomesACaseThatReadsBack) {
    const Case base = test::clamped_block();
    ASSERT_GE(base.markers.size(), 2U);
    StreamWindow window(base, 10.0);
    for (int f = 0; f < 200; ++f) {  // 20 s at 10 Hz, loads at 5 Hz: their number, in newtons
        const std::int64_t us = kStart + 100'000 * f;
        if (f % 2 == 0) window.add(loads_at(base, us, f));
        window.add(markers_at(base, us, f == 150 ? base.markers.size() - 1 : base.markers.size()));
    }
    const std::int64_t from = kStart + 14'050'000;  // frame 141 is the first
    const auto cut = window.cut(from, 30);
    ASSERT_TRUE(cut) << cut.error().text;
    EXPECT_EQ(cut->num_frames, 30);  // 59 frames, every second one
    EXPECT_NEAR(cut->dt_s, 0.2, 1e-9);

    const test::ScratchFolder folder;
    ASSERT_TRUE(write_case(*cut, folder.path() / "window"));
    const auto read = read_case(folder.path() / "window");
    ASSERT_TRUE(read) << read.error().text;
    EXPECT_EQ(read->observations.size(), 30 * base.markers.size());
    for (const PositionSample& o : read->observations) {
        const double frame = 141.0 + 10.0 * o.t_s;
        if (o.id != base.markers.front().id) continue;
        EXPECT_NEAR(o.position_m[0], base.markers.front().position_m[0] + 1e-4 * frame, 1e-9) << o.t_s;
    }
    // Frame 141 is computed with the loads of frame 140, as the estimator does it.
    ASSERT_FALSE(read->loads.empty());
    for (const LoadSample& l : read->loads)
        EXPECT_NEAR(l.force_n[0], l.region == 0 ? 140.0 + 10.0 * l.t_s : 0.0, 1e-6) << l.t_s;
}

TEST(StreamWindow, MissingMarkersAreLostNotInvented) {
    const Case base = test::clamped_block();
    StreamWindow window(base, 10.0);
    for (int f = 0; f < 20; ++f) window.add(markers_at(base, kStart + 100'000 * f, base.markers.size() - (f == 5)));
    const auto cut = window.cut(0, 100);
    ASSERT_TRUE(cut);
    int lost = 0;
    for (const PositionSample& o : cut->observations) lost += std::isnan(o.position_m[0]) ? 1 : 0;
    EXPECT_EQ(lost, 1);
}

TEST(StreamWindow, IsBoundedAndBeginsAnewWhenTimeRunsBack) {
    const Case base = test::clamped_block();
    StreamWindow window(base, 2.0);
    for (int f = 0; f < 100; ++f) window.add(markers_at(base, kStart + 100'000 * f, base.markers.size()));
    EXPECT_EQ(window.cut(0, 1000)->num_frames, 21);
    for (int f = 0; f < 4; ++f) window.add(markers_at(base, kStart + 100'000 * f, base.markers.size()));
    const auto cut = window.cut(0, 1000);
    ASSERT_FALSE(cut);
    EXPECT_NE(cut.error().text.find("4 marker frames"), std::string::npos) << cut.error().text;
}

}  // namespace
}  // namespace teres::tools
