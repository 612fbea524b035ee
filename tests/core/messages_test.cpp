// Hostile packets against the decoders of every message type: refused, no exception, no allocation beyond the
// packet.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <teres/boundary_estimate_t.hpp>
#include <teres/channel_health_t.hpp>
#include <teres/header_t.hpp>
#include <teres/health_t.hpp>
#include <teres/innovation_t.hpp>
#include <teres/liver_state_t.hpp>
#include <teres/markers_t.hpp>
#include <teres/tool_loads_t.hpp>
#include <teres/unit_health_t.hpp>
#include <vector>

namespace teres {
namespace {

using Packet = std::vector<std::uint8_t>;

template <class Message>
Packet encoded(const Message& message) {
    Packet packet(static_cast<std::size_t>(message.getEncodedSize()));
    EXPECT_EQ(message.encode(packet.data(), 0, static_cast<int>(packet.size())), static_cast<int>(packet.size()));
    return packet;
}

template <class Message>
int decoded(const Packet& packet, Message& message) {
    // A heap copy of the exact size: the address sanitizer sees any read behind the end.
    const Packet copy(packet);
    return message.decode(copy.data(), 0, static_cast<int>(copy.size()));
}

void put_int32(Packet& packet, std::size_t at, std::int32_t value) {
    for (int i = 0; i < 4; ++i)
        packet.at(at + static_cast<std::size_t>(i)) =
            static_cast<std::uint8_t>(static_cast<std::uint32_t>(value) >> (24 - 8 * i));
}

header_t make_header() {
    header_t header;
    header.capture_stamp_us = 123456789;
    header.sequence = 42;
    header.frame_id = "case";
    return header;
}

markers_t make_markers() {
    markers_t m;
    m.header = make_header();
    m.num_markers = 3;
    m.marker_id = {7, 8, 9};
    m.x_m = {0.1, std::numeric_limits<double>::quiet_NaN(), -0.3};
    m.y_m = m.z_m = m.sigma_m = {1.0, 2.0, 3.0};
    return m;
}

tool_loads_t make_tool_loads() {
    tool_loads_t m;
    m.header = make_header();
    m.num_regions = 2;
    m.region = {"left", "right"};
    m.fx_n = m.fy_n = m.fz_n = {1.0, 2.0};
    m.num_tools = 1;
    m.tool = {"grasper"};
    m.x_m = m.y_m = m.z_m = {0.5};
    return m;
}

health_t make_health() {
    health_t m{};
    m.header = make_header();
    m.num_channels = 2;
    m.channels.resize(2);
    m.channels[0].channel = "MARKERS";
    m.channels[1].channel = "GAP";
    m.num_units = 1;
    m.units.resize(1);
    m.units[0].unit = "replay";
    m.units[0].state = "running";
    return m;
}

constexpr std::size_t kHash = 8;
constexpr std::size_t kHeaderBytes = 8 + 8 + 4 + 5;   // stamps, length of "case", "case\0"
constexpr std::size_t kCount = kHash + kHeaderBytes;  // of the first array

TEST(MessageDecoder, RoundTripKeepsEveryBit) {
    markers_t out;
    const markers_t in = make_markers();
    ASSERT_GT(decoded(encoded(in), out), 0);
    EXPECT_EQ(out.marker_id, in.marker_id);
    EXPECT_EQ(std::memcmp(out.x_m.data(), in.x_m.data(), sizeof(double) * 3), 0);
    EXPECT_EQ(out.header.frame_id, "case");
}

class HostileCount : public testing::TestWithParam<std::int32_t> {};

TEST_P(HostileCount, IsRefusedByArraysOfNumbers) {
    Packet packet = encoded(make_markers());
    put_int32(packet, kCount, GetParam());
    markers_t out;
    EXPECT_NO_THROW(EXPECT_LT(decoded(packet, out), 0));
    EXPECT_LE(out.marker_id.capacity(), packet.size());
}

TEST_P(HostileCount, IsRefusedByArraysOfStrings) {
    Packet packet = encoded(make_tool_loads());
    put_int32(packet, kCount, GetParam());
    tool_loads_t out;
    EXPECT_NO_THROW(EXPECT_LT(decoded(packet, out), 0));
    EXPECT_LE(out.region.capacity(), packet.size());
}

TEST_P(HostileCount, IsRefusedByArraysOfMessages) {
    Packet packet = encoded(make_health());
    put_int32(packet, kCount + 5 * 8, GetParam());  // after uptime, two memories, iterations, loop time
    health_t out;
    EXPECT_NO_THROW(EXPECT_LT(decoded(packet, out), 0));
    EXPECT_LE(out.channels.capacity(), packet.size());
}

TEST_P(HostileCount, IsRefusedAsLengthOfString) {
    Packet packet = encoded(make_markers());
    put_int32(packet, kHash + 16, GetParam());  // of frame_id
    markers_t out;
    EXPECT_NO_THROW(EXPECT_LT(decoded(packet, out), 0));
    packet = encoded(make_tool_loads());
    put_int32(packet, kCount + 4, GetParam());  // of region[0]
    tool_loads_t loads;
    EXPECT_NO_THROW(EXPECT_LT(decoded(packet, loads), 0));
}

INSTANTIATE_TEST_SUITE_P(Lengths, HostileCount,
                         testing::Values(-1, -2, std::numeric_limits<std::int32_t>::min(), 0x7fffffff, 0x7ffffffe,
                                         0x20000001, 0x10000000, 1000));

TEST(MessageDecoder, RefusesEveryTruncation) {
    const auto check = [](const auto& message) {
        const Packet whole = encoded(message);
        for (std::size_t size = 0; size < whole.size(); ++size) {
            std::decay_t<decltype(message)> out;
            EXPECT_NO_THROW(EXPECT_LT(decoded(Packet(whole.begin(), whole.begin() + static_cast<long>(size)), out), 0))
                << size;
        }
    };
    check(make_markers());
    check(make_tool_loads());
    check(make_health());
}

TEST(MessageDecoder, RefusesStringWithoutTerminatorOrWithZeroInside) {
    Packet packet = encoded(make_markers());
    header_t unused;
    markers_t out;
    const std::size_t text = kHash + 16 + 4;
    ASSERT_EQ(packet[text], 'c');
    packet[text + 4] = 'x';
    EXPECT_LT(decoded(packet, out), 0);
    packet[text + 4] = 0;
    packet[text + 1] = 0;
    EXPECT_LT(decoded(packet, out), 0);
}

TEST(MessageDecoder, RefusesHashOfAnotherType) {
    tool_loads_t out;
    EXPECT_LT(decoded(encoded(make_markers()), out), 0);
}

TEST(MessageDecoder, EmptyArrayLeavesNothingOfTheMessageBefore) {
    markers_t reused = make_markers(), empty;
    empty.header = make_header();
    empty.num_markers = 0;
    ASSERT_GT(decoded(encoded(empty), reused), 0);
    EXPECT_TRUE(reused.marker_id.empty());
    EXPECT_TRUE(reused.x_m.empty());
}

// Bytes changed at random in valid packets: whatever is accepted can be encoded again.
template <class Message>
void scramble(const Message& message, unsigned seed) {
    std::mt19937 random(seed);
    const Packet whole = encoded(message);
    int accepted = 0;
    for (int i = 0; i < 3000; ++i) {
        Packet packet = whole;
        for (int k = 0; k < 3; ++k)
            packet[kHash + random() % (packet.size() - kHash)] = static_cast<std::uint8_t>(random());
        Message out{};
        ASSERT_NO_THROW({
            if (decoded(packet, out) > 0) {
                ++accepted;
                encoded(out);
            }
        });
    }
    EXPECT_GT(accepted, 0);
    EXPECT_LT(accepted, 3000);
}

TEST(MessageDecoder, SurvivesScrambledPackets) {
    scramble(make_markers(), 1);
    scramble(make_tool_loads(), 2);
    scramble(make_health(), 3);
}

}  // namespace
}  // namespace teres
