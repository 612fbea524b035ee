#include "tools/spy_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "teres/markers_t.hpp"
#include "tools/message_fields.h"

namespace teres::tools {
namespace {

using ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

Bytes markers(std::int64_t sequence, double x_m = 0.125) {
    markers_t m;
    m.header.sequence = sequence;
    m.header.frame_id = "case";
    m.num_markers = 2;
    m.marker_id = {3, 4};
    m.x_m = {x_m, std::numeric_limits<double>::quiet_NaN()};
    m.y_m = m.z_m = m.sigma_m = {0.0, 0.0};
    Bytes data(static_cast<std::size_t>(m.getEncodedSize()));
    m.encode(data.data(), 0, static_cast<int>(data.size()));
    return data;
}

// 25 Hz with every fourth interval 8 ms too long and the next 8 ms too short: mean 40 ms.
TEST(SpyTable, MeasuresRateBytesAndJitter) {
    SpyTable table;
    std::vector<double> intervals_s;
    std::int64_t at_us = 1'000'000, before_us = 0;
    for (int i = 0; i < 65; ++i) {
        const std::int64_t late_us = i % 4 == 0 ? 8000 : 0;
        if (i > 1) intervals_s.push_back(static_cast<double>(at_us + late_us - before_us) * 1e-6);
        before_us = at_us + late_us;
        table.add("A", Bytes(100), before_us);
        at_us += 40'000;
    }
    double mean_s = 0.0, variance = 0.0;
    for (const double s : intervals_s) mean_s += s / static_cast<double>(intervals_s.size());
    for (const double s : intervals_s)
        variance += (s - mean_s) * (s - mean_s) / static_cast<double>(intervals_s.size());
    const SpyRow row = table.rows(before_us + 5000).at(0);
    EXPECT_EQ(row.messages, 65);
    EXPECT_EQ(row.bytes, 6500);
    EXPECT_NEAR(row.rate_hz, 1.0 / mean_s, 1e-9);
    EXPECT_NEAR(row.bytes_per_s, 100.0 / mean_s, 1e-6);
    EXPECT_NEAR(row.jitter_ms, 1e3 * std::sqrt(variance), 1e-9);
    EXPECT_NEAR(row.age_s, 0.005, 1e-9);
}

TEST(SpyTable, RateFallsWhenAChannelGoesSilent) {
    SpyTable table;
    for (int i = 0; i < 11; ++i) table.add("A", Bytes(1), 100'000 * i);
    EXPECT_NEAR(table.rows(1'000'000).at(0).rate_hz, 10.0, 1e-9);
    EXPECT_LT(table.rows(11'000'000).at(0).rate_hz, 1.0);
}

TEST(SpyTable, CountsGapsAndRestartsOfTheSequence) {
    SpyTable table;
    for (const std::int64_t sequence : {7, 8, 11, 12, 1, 2}) table.add("MARKERS", markers(sequence), 0);
    const SpyRow row = table.rows(0).at(0);
    EXPECT_EQ(row.lost, 2);
    EXPECT_EQ(row.restarts, 1);
    EXPECT_EQ(row.type, "teres.markers_t");
    EXPECT_EQ(row.fields["sequence"], 2);
    EXPECT_EQ(row.fields["lost"], 1);
    EXPECT_EQ(row.fields["x_m"][0], 0.125);
}

TEST(SpyTable, SurvivesWhateverIsOnTheNetwork) {
    SpyTable table;
    table.add("EMPTY", {}, 0);
    table.add("SHORT", Bytes(7, 1), 0);
    table.add("UNKNOWN", Bytes{0xde, 0xad, 0xbe, 0xef, 0, 0, 0, 1, 5}, 0);
    Bytes cut = markers(1);
    cut.resize(40);
    table.add("CUT", cut, 0);
    table.add("\033[31mRED\xff", markers(std::numeric_limits<std::int64_t>::min()), 0);
    table.add("\033[31mRED\xff", markers(std::numeric_limits<std::int64_t>::max()), 0);
    for (int i = 0; i < 1000; ++i) table.add(std::string("C") + std::to_string(i), Bytes(1), i);
    const auto rows = table.rows(0);
    EXPECT_LE(rows.size(), SpyTable::kMaxChannels + 1);
    const std::string text = as_text(rows, 120);
    EXPECT_EQ(text.find('\033'), std::string::npos);
    EXPECT_THAT(text, HasSubstr("?[31mRED?"));
    EXPECT_THAT(text, HasSubstr("0xdeadbeef00000001"));
    EXPECT_THAT(text, HasSubstr("(other)"));
    for (std::size_t begin = 0, end; begin < text.size(); begin = end + 1) {
        end = text.find('\n', begin);
        ASSERT_NE(end, std::string::npos);
        EXPECT_LE(end - begin, 120u);
    }
    const auto json = nlohmann::json::parse(as_json(rows));
    EXPECT_EQ(json["channels"].size(), rows.size());
}

TEST(MessageFields, CutLongArraysAndNameMalformedOnes) {
    markers_t m;
    m.num_markers = 100;
    m.marker_id.assign(100, 1);
    m.x_m.assign(100, 0.5);
    m.y_m = m.z_m = m.sigma_m = m.x_m;
    Bytes data(static_cast<std::size_t>(m.getEncodedSize()));
    m.encode(data.data(), 0, static_cast<int>(data.size()));
    const MessageFields fields = message_fields(data);
    EXPECT_EQ(fields.values["num_markers"], 100);
    EXPECT_EQ(fields.values["x_m"].size(), 8u);
    data.pop_back();
    EXPECT_EQ(message_fields(data).type, "teres.markers_t");
    EXPECT_TRUE(message_fields(data).values.is_null());
}

}  // namespace
}  // namespace teres::tools
