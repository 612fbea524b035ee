// Level 3: 640x480 colour and depth over the loopback bus at 30 and 60 Hz: what is lost, how long it takes. Prints the table
// of VALIDATION.md. Label `long`: a busy machine would judge itself, not the bus.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <thread>

#include "core/bus.h"
#include "core/clock.h"
#include "tests/support/private_network.h"

namespace teres {
namespace {

constexpr std::size_t kColorBytes = 640 * 480 * 3, kDepthBytes = 640 * 480 * 2;
constexpr int kSeconds = 10;

struct Tally {
    std::vector<double> latency_ms;
    int damaged = 0;
};

void run(int rate_hz, Tally& tally) {
    const std::string url = std::string(test::kLoopbackUrl) + "&recv_buf_size=16777216";
    auto to = Bus::open(url), from = Bus::open(url);
    ASSERT_TRUE(to && from);
    const auto handler = [&](auto, std::span<const std::uint8_t> data, auto) {
        std::int64_t sent_us = 0;
        std::memcpy(&sent_us, data.data(), sizeof sent_us);
        tally.latency_ms.push_back(1e-3 * static_cast<double>(monotonic_us() - sent_us));
        if (data.back() != data[8]) ++tally.damaged;
    };
    ASSERT_TRUE(to->subscribe("CAMERA_.*", 1 << 20, handler));
    const int pairs = kSeconds * rate_hz;
    std::thread publisher([&] {
        std::vector<std::uint8_t> color(kColorBytes), depth(kDepthBytes);
        auto due = std::chrono::steady_clock::now();
        for (int i = 0; i < pairs; ++i) {
            for (auto* image : {&color, &depth}) {
                std::fill(image->begin(), image->end(), static_cast<std::uint8_t>(i));
                const std::int64_t now_us = monotonic_us();
                std::memcpy(image->data(), &now_us, sizeof now_us);
                from->publish(image == &color ? "CAMERA_COLOR" : "CAMERA_DEPTH", *image);
            }
            std::this_thread::sleep_until(due += std::chrono::microseconds(1'000'000 / rate_hz));
        }
    });
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(kSeconds + 2);
    while (static_cast<int>(tally.latency_ms.size()) < 2 * pairs && std::chrono::steady_clock::now() < end)
        to->dispatch(20);
    publisher.join();
    std::sort(tally.latency_ms.begin(), tally.latency_ms.end());
    const auto percentile = [&](double p) {
        return tally.latency_ms.empty() ? -1.0 : tally.latency_ms[static_cast<std::size_t>(p * (tally.latency_ms.size() - 1.0))];
    };
    std::printf("| %d Hz | %d of %d | %.2f | %.2f | %.2f |\n", rate_hz, 2 * pairs - static_cast<int>(tally.latency_ms.size()),
                2 * pairs, percentile(0.5), percentile(0.99), percentile(1.0));
}

TEST(BusRate, ColorAndDepthAt30And60HzArriveWholeAndAll) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    std::printf("| rate | lost | p50 [ms] | p99 [ms] | max [ms] |\n");
    for (const int rate_hz : {30, 60}) {
        Tally tally;
        run(rate_hz, tally);
        EXPECT_EQ(tally.latency_ms.size(), static_cast<std::size_t>(2 * kSeconds * rate_hz));
        EXPECT_EQ(tally.damaged, 0);
    }
}

}  // namespace
}  // namespace teres
