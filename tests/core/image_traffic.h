// Image pairs (640x480 colour and depth) over a bus: what arrives, how late. For the measurements of VALIDATION.md.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "core/bus.h"
#include "core/clock.h"

namespace teres::test {

inline constexpr std::size_t kColorBytes = 640 * 480 * 3, kDepthBytes = 640 * 480 * 2, kMarkerBytes = 1000;

struct Traffic {
    int images = 0, markers = 0, damaged = 0;  // received
    std::vector<double> latency_ms;            // of images, sorted

    double percentile_ms(double p) const {
        return latency_ms.empty()
                   ? -1.0
                   : latency_ms[static_cast<std::size_t>(p * (static_cast<double>(latency_ms.size()) - 1.0))];
    }
    void print(const std::string& name, int pairs) const {
        std::printf("| %s | %d of %d | %d of %d | %.2f | %.2f | %.2f |\n", name.c_str(), 2 * pairs - images, 2 * pairs,
                    pairs - markers, pairs, percentile_ms(0.5), percentile_ms(0.99), percentile_ms(1.0));
        std::fflush(stdout);
    }
};
inline constexpr const char* kTrafficHeading =
    "| | images lost | small messages lost | p50 [ms] | p99 [ms] | max [ms] |\n|---|---|---|---|---|---|\n";

/// A colour and a depth image, and a message of 1 kB, `rate_hz` times a second.
inline void send_traffic(const std::string& url, int rate_hz, int pairs) {
    auto bus = Bus::open(url);
    if (!bus) return;
    std::vector<std::uint8_t> color(kColorBytes), depth(kDepthBytes), markers(kMarkerBytes);
    std::this_thread::sleep_for(std::chrono::milliseconds(300));  // until the receiver listens
    auto due = std::chrono::steady_clock::now();
    for (int i = 0; i < pairs; ++i) {
        for (auto [message, channel] :
             {std::pair{&color, "CAMERA_COLOR"}, {&depth, "CAMERA_DEPTH"}, {&markers, "MARKERS"}}) {
            std::fill(message->begin(), message->end(), static_cast<std::uint8_t>(i));
            const std::int64_t now_us = monotonic_us();
            std::memcpy(message->data(), &now_us, sizeof now_us);
            bus->publish(channel, *message);
        }
        std::this_thread::sleep_until(due += std::chrono::microseconds(1'000'000 / rate_hz));
    }
}

/// All that came until everything is there or `seconds` are over.
inline Traffic receive_traffic(Bus& bus, int pairs, double seconds) {
    Traffic traffic;
    const auto handler = [&](std::string_view channel, std::span<const std::uint8_t> data, auto) {
        if (data.back() != data[8]) ++traffic.damaged;
        if (channel == "MARKERS") {
            ++traffic.markers;
            return;
        }
        std::int64_t sent_us = 0;
        std::memcpy(&sent_us, data.data(), sizeof sent_us);
        traffic.latency_ms.push_back(1e-3 * static_cast<double>(monotonic_us() - sent_us));
        ++traffic.images;
    };
    if (!bus.subscribe("CAMERA_.*|MARKERS", 1 << 20, handler)) return traffic;
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (traffic.images + traffic.markers < 3 * pairs && std::chrono::steady_clock::now() < end) bus.dispatch(20);
    std::sort(traffic.latency_ms.begin(), traffic.latency_ms.end());
    return traffic;
}

}  // namespace teres::test
