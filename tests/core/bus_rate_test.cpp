// Level 3: 640x480 colour and depth over the loopback bus at 30 and 60 Hz, and between two hosts (network namespaces,
// MTU 1500) without and with loss of Ethernet frames: what is lost, how long it takes. Prints the tables of
// VALIDATION.md. Label `long`: a busy machine would judge itself, not the bus.
#include <gtest/gtest.h>

#include <fcntl.h>
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <future>

#include "tests/core/image_traffic.h"
#include "tests/support/private_network.h"

namespace teres {
namespace {

constexpr int kSeconds = 10;

TEST(BusRate, ColorAndDepthAt30And60HzArriveWholeAndAll) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    const std::string url = std::string(test::kLoopbackUrl) + "&recv_buf_size=16777216";
    std::printf("%s", test::kTrafficHeading);
    for (const int rate_hz : {30, 60}) {
        auto bus = Bus::open(url);
        ASSERT_TRUE(bus);
        const int pairs = kSeconds * rate_hz;
        std::thread sender([&] { test::send_traffic(url, rate_hz, pairs); });
        const test::Traffic traffic = test::receive_traffic(*bus, pairs, kSeconds + 3);
        sender.join();
        traffic.print("loopback, " + std::to_string(rate_hz) + " Hz", pairs);
        EXPECT_EQ(traffic.images, 2 * pairs);
        EXPECT_EQ(traffic.damaged, 0);
    }
}

bool run(const std::string& command) {
    return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

// A second host: a thread in a network namespace of its own, joined to this one's by a virtual cable.
class SecondHost {
  public:
    SecondHost() : thread_([this] { live(); }) {
        const int thread_id = started_.get_future().get();
        good_ = thread_id > 0 && run("ip link add near type veth peer name far netns " + std::to_string(thread_id)) &&
                run("ip addr add 10.77.0.1/24 dev near && ip link set near up && ip route add 224.0.0.0/4 dev near");
        cabled_.set_value();
        good_ = ready_.get_future().get() && good_;
    }
    ~SecondHost() {
        ended_.set_value();
        thread_.join();
        run("ip link del near");
    }
    bool good() const { return good_; }
    /// Runs there, waits for the end.
    template <class Work>
    auto there(Work work) {
        std::packaged_task<std::invoke_result_t<Work>()> task(work);
        auto result = task.get_future();
        std::thread([&] {
            setns(namespace_, CLONE_NEWNET);
            task();
        }).join();
        return result.get();
    }

  private:
    void live() {
        const bool own = unshare(CLONE_NEWNET) == 0;
        namespace_ = open("/proc/thread-self/ns/net", 0);
        started_.set_value(own ? static_cast<int>(syscall(SYS_gettid)) : -1);
        cabled_.get_future().wait();
        ready_.set_value(own && run("ip link set lo up && ip addr add 10.77.0.2/24 dev far && ip link set far up && "
                                    "ip route add 224.0.0.0/4 dev far"));
        ended_.get_future().wait();
        close(namespace_);
    }
    std::promise<int> started_;
    std::promise<void> cabled_, ended_;
    std::promise<bool> ready_;
    int namespace_ = -1;
    bool good_ = false;
    std::thread thread_;
};

struct Link {
    const char* name;
    int rate_hz;
    int one_lost_of;  // Ethernet frames; 0: none
    bool tuned;       // reassembly as the package sets it
};

TEST(BusRate, BetweenTwoHostsSmallMessagesOutliveALossThatTakesImages) {
    TERES_REQUIRE_PRIVATE_NETWORK();
    const std::string url = "udpm://239.255.76.67:7667?ttl=1&recv_buf_size=16777216";
    run("ip route del 239.255.76.67/32 dev lo");
    std::printf("%s", test::kTrafficHeading);
    const Link links[] = {{"30 Hz", 30, 0, true},
                          {"60 Hz", 60, 0, true},
                          {"30 Hz, 1 of 10,000 frames lost", 30, 10'000, true},
                          {"30 Hz, 1 of 1,000 frames lost", 30, 1'000, true},
                          {"30 Hz, 1 of 1,000, kernel's defaults for reassembly", 30, 1'000, false},
                          {"30 Hz, 1 of 100 frames lost", 30, 100, true}};
    for (const Link& link : links) {
        SecondHost second;
        if (!second.good()) GTEST_SKIP() << "SKIPPED LOUDLY: no virtual cable between network namespaces (ip, veth)";
        const bool set_up = second.there([&] {
            if (link.tuned)
                for (auto [key, value] : {std::pair{"ipfrag_time", 2}, {"ipfrag_high_thresh", 134'217'728}})
                    std::ofstream(std::string("/proc/sys/net/ipv4/") + key) << value;
            return link.one_lost_of == 0 ||
                   run("nft 'add table netdev t' && nft 'add chain netdev t c { type filter hook ingress device far "
                       "priority 0; }' && nft add rule netdev t c numgen random mod " +
                       std::to_string(link.one_lost_of) + " '<' 1 drop");
        });
        if (!set_up) GTEST_SKIP() << "SKIPPED LOUDLY: nft cannot drop frames here";
        const int pairs = kSeconds * link.rate_hz;
        std::promise<void> listening;
        std::thread sender([&] {
            listening.get_future().wait();
            test::send_traffic(url, link.rate_hz, pairs);
        });
        const test::Traffic traffic = second.there([&] {
            auto bus = Bus::open(url);
            listening.set_value();
            return bus ? test::receive_traffic(*bus, pairs, kSeconds + 3) : test::Traffic{};
        });
        sender.join();
        traffic.print(link.name, pairs);
        EXPECT_EQ(traffic.damaged, 0) << "what arrives is whole";
        // Frames of 1480 bytes, every one of which must arrive; a margin of four standard deviations.
        const auto lost_at_most = [&](std::size_t bytes, int count) {
            if (link.one_lost_of == 0) return 0.01 * count;
            const double p =
                1.0 - std::pow(1.0 - 1.0 / link.one_lost_of, std::ceil(static_cast<double>(bytes) / 1480.0));
            return count * p + 4.0 * std::sqrt(count * p * (1.0 - p)) + 2.0;
        };
        EXPECT_LE(pairs - traffic.markers, lost_at_most(test::kMarkerBytes, pairs)) << link.name;
        if (link.tuned) {
            EXPECT_LE(2 * pairs - traffic.images,
                      lost_at_most(test::kColorBytes, pairs) + lost_at_most(test::kDepthBytes, pairs))
                << link.name;
        }
    }
}

}  // namespace
}  // namespace teres
