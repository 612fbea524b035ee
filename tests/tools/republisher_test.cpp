// What leaves by the chosen interface is read by LCM itself; what is above the limits stays.
#include "tools/republisher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "core/bus.h"
#include "tests/support/private_network.h"

namespace teres::tools {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr const char* kGroup = "239.255.76.67:7668";  // another port than the bus; the test's namespace has this route

TEST(Republisher, WhatItSendsIsWhatLcmReceives) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    auto listener = Bus::open(std::string("udpm://") + kGroup + "?ttl=0&recv_buf_size=4194304");
    ASSERT_TRUE(listener) << listener.error().text;
    std::map<std::string, Bytes> heard;
    ASSERT_TRUE(
        listener->subscribe(".*", 1 << 21, [&](std::string_view channel, std::span<const std::uint8_t> data, auto) {
            heard[std::string(channel)].assign(data.begin(), data.end());
        }));
    auto republisher = Republisher::open("lo", kGroup, 0, {1e9, 1000.0, 1 << 20});
    ASSERT_TRUE(republisher) << republisher.error().text;
    // Around the border between one packet and fragments, and with a last fragment of one byte.
    std::map<std::string, Bytes> sent;
    for (const std::size_t size : {0, 1, 1396, 1397, 1400, 2596, 2597, 100'000, 700'001}) {
        Bytes data(size);
        for (std::size_t i = 0; i < size; ++i) data[i] = static_cast<std::uint8_t>(i * 31 + size);
        const std::string channel = "C" + std::to_string(sent.size());
        sent[channel] = data;
        republisher->message(channel, data, 0);
    }
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (heard.size() < sent.size() && std::chrono::steady_clock::now() < end) listener->dispatch(20);
    EXPECT_TRUE(heard == sent) << heard.size() << " of " << sent.size() << " came";
    EXPECT_EQ(republisher->counters().sent, static_cast<std::int64_t>(sent.size()));
}

TEST(Republisher, LimitsHoldPerChannelAndOverAll) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    auto republisher = Republisher::open("lo", kGroup, 0, {10'000.0, 2.0, 100'000});
    ASSERT_TRUE(republisher);
    const auto sent = [&](const char* channel, std::size_t size, double t_s) {
        const std::int64_t before = republisher->counters().sent;
        republisher->message(channel, Bytes(size), static_cast<std::int64_t>(1e6 * t_s));
        return republisher->counters().sent > before;
    };
    EXPECT_TRUE(sent("A", 10, 0.0));
    EXPECT_TRUE(sent("A", 10, 0.0));
    EXPECT_FALSE(sent("A", 10, 0.0)) << "two a second";
    EXPECT_TRUE(sent("B", 10, 0.0)) << "another channel has its own";
    EXPECT_TRUE(sent("A", 10, 0.6));
    EXPECT_FALSE(sent("B", 100'001, 10.0)) << "above the size";
    EXPECT_TRUE(sent("C", 9'000, 20.0));
    EXPECT_FALSE(sent("D", 9'000, 20.0)) << "ten kilobytes a second over all";
    EXPECT_TRUE(sent("D", 9'000, 21.0));
    EXPECT_EQ(republisher->counters().held_back, 3);
}

TEST(Republisher, WrongInterfaceOrGroupIsNamed) {
    EXPECT_THAT(Republisher::open("nonesuch0", kGroup, 0, {}).error().text,
                testing::HasSubstr("no interface nonesuch0"));
    for (const char* bad : {"", "239.255.76.67", "10.0.0.1:7668", "239.255.76.67:0", "239.255.76.67:99999", "x:1"})
        EXPECT_FALSE(Republisher::open("lo", bad, 0, {})) << bad;
}

}  // namespace
}  // namespace teres::tools
