#include "core/bus.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "core/clock.h"
#include "core/udpm_guard.h"
#include "tests/support/private_network.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bus open(const std::string& url) {
    auto bus = Bus::open(url);
    EXPECT_TRUE(bus) << bus.error().text;
    return std::move(*bus);
}

struct Listener {
    std::vector<std::string> channels;
    std::vector<Bytes> data;
    std::vector<std::int64_t> receive_us;
    Bus::Handler handler() {
        return [this](std::string_view channel, std::span<const std::uint8_t> bytes, std::int64_t at_us) {
            channels.emplace_back(channel);
            data.emplace_back(bytes.begin(), bytes.end());
            receive_us.push_back(at_us);
        };
    }
};

// Dispatches until `count` messages came or two seconds passed.
template <class Done>
void dispatch_until(Bus& bus, Done done) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(2);
    while (!done() && std::chrono::steady_clock::now() < end) bus.dispatch(20);
}

const Bytes kSmall(16, 7);

TEST(MemqBus, DeliversInOrderToEveryMatchingSubscription) {
    Bus bus = open("memq://");
    Listener all, some;
    ASSERT_TRUE(bus.subscribe(".*", 100, all.handler()));
    ASSERT_TRUE(bus.subscribe("A|B.*", 100, some.handler()));
    for (const char* channel : {"A", "B1", "AB", "C", "B"}) EXPECT_TRUE(bus.publish(channel, kSmall));
    EXPECT_TRUE(all.channels.empty());  // publishing never calls a handler
    EXPECT_EQ(bus.dispatch(0), 8);
    EXPECT_EQ(all.channels, (std::vector<std::string>{"A", "B1", "AB", "C", "B"}));
    EXPECT_EQ(some.channels, (std::vector<std::string>{"A", "B1", "B"}));
    EXPECT_EQ(some.data[0], kSmall);
    EXPECT_EQ(bus.dispatch(0), 0);
}

TEST(MemqBus, StampsWithTheMonotonicClock) {
    Bus bus = open("memq://");
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 100, listener.handler()));
    const std::int64_t before = monotonic_us();
    bus.publish("A", kSmall);
    bus.dispatch(0);
    ASSERT_EQ(listener.receive_us.size(), 1u);
    EXPECT_GE(listener.receive_us[0], before - 1000);
    EXPECT_LE(listener.receive_us[0], monotonic_us() + 1000);
}

TEST(MemqBus, RefusesAndCountsWhatIsTooLargeForTheSubscriber) {
    Bus bus = open("memq://");
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 10, listener.handler()));
    bus.publish("A", Bytes(10));
    bus.publish("A", Bytes(11));
    EXPECT_EQ(bus.dispatch(0), 1);
    EXPECT_EQ(bus.counters().received, 1);
    EXPECT_EQ(bus.counters().refused, 1);
}

TEST(MemqBus, BoundsItsQueueAndLosesNothingItAccepted) {
    Bus bus = open("memq://");
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 100, listener.handler()));
    int accepted = 0;
    while (accepted < 100'000 && bus.publish("A", kSmall)) ++accepted;
    EXPECT_EQ(accepted, 4096);
    EXPECT_EQ(bus.counters().refused, 1);
    while (bus.dispatch(0) > 0) {
    }
    EXPECT_EQ(listener.channels.size(), 4096u);
    EXPECT_TRUE(bus.publish("A", kSmall));
}

TEST(MemqBus, BoundsTheBytesThatWait) {
    Bus bus = open("memq://");
    std::size_t delivered = 0;
    ASSERT_TRUE(bus.subscribe("A", kMaxMessageBytes, [&](auto, auto data, auto) { delivered += data.size(); }));
    const Bytes large(kMaxMessageBytes);
    for (int i = 0; i < 4; ++i) EXPECT_TRUE(bus.publish("A", large));
    EXPECT_FALSE(bus.publish("A", kSmall));
    EXPECT_EQ(bus.dispatch(0), 4);
    EXPECT_EQ(delivered, 4 * kMaxMessageBytes);
    EXPECT_TRUE(bus.publish("A", kSmall));
    EXPECT_FALSE(bus.publish("A", Bytes(kMaxMessageBytes + 1)));
}

TEST(MemqBus, NobodyListeningFillsNoQueue) {
    Bus bus = open("memq://");
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 100, listener.handler()));
    for (int i = 0; i < 10'000; ++i) EXPECT_TRUE(bus.publish("B", kSmall));
    EXPECT_TRUE(bus.publish("A", kSmall));
    EXPECT_EQ(bus.dispatch(0), 1);
}

TEST(MemqBus, ThrowingHandlerStopsNeitherTheLoopNorTheOthers) {
    Bus bus = open("memq://");
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 100, [](auto, auto, auto) { throw std::runtime_error("no"); }));
    ASSERT_TRUE(bus.subscribe("A", 100, listener.handler()));
    bus.publish("A", kSmall);
    bus.publish("A", kSmall);
    bus.dispatch(0);
    EXPECT_EQ(listener.channels.size(), 2u);
    EXPECT_EQ(bus.counters().refused, 2);
}

TEST(MemqBus, DispatchEndsThoughHandlersKeepPublishing) {
    Bus bus = open("memq://");
    ASSERT_TRUE(bus.subscribe("A", 100, [&](auto, auto, auto) { bus.publish("A", kSmall); }));
    bus.publish("A", kSmall);
    EXPECT_EQ(bus.dispatch(0), 1024);
}

TEST(MemqBus, WaitsNoLongerThanAsked) {
    Bus bus = open("memq://");
    ASSERT_TRUE(bus.subscribe("A", 100, [](auto, auto, auto) {}));
    const auto start = std::chrono::steady_clock::now();
    EXPECT_EQ(bus.dispatch(30), 0);
    const auto waited = std::chrono::steady_clock::now() - start;
    EXPECT_GE(waited, std::chrono::milliseconds(29));
    EXPECT_LT(waited, std::chrono::seconds(2));
}

TEST(Bus, RefusesBadChannelsAndExpressions) {
    Bus bus = open("memq://");
    EXPECT_FALSE(bus.publish("", kSmall));
    EXPECT_FALSE(bus.publish(std::string(64, 'A'), kSmall));
    EXPECT_TRUE(bus.publish(std::string(63, 'A'), kSmall));
    EXPECT_EQ(bus.counters().refused, 2);
    const Status status = bus.subscribe("(", 100, [](auto, auto, auto) {});
    ASSERT_FALSE(status);
    EXPECT_NE(status.error().text.find("'('"), std::string::npos);
}

TEST(Bus, NamesProviderAndBoundWhenItCannotOpen) {
    const auto text = [](const std::string& url) { return Bus::open(url).error().text; };
    EXPECT_NE(text("nonsense").find("memq://, udpm:// or file://"), std::string::npos);
    EXPECT_NE(text("file:///does/not/exist").find("/does/not/exist: No such file"), std::string::npos);
    EXPECT_NE(text("file:///dev/null?speed=-1").find("[0, 1e6]"), std::string::npos);
    EXPECT_NE(text("file:///dev/null?sped=1").find("'sped=1'"), std::string::npos);
}

TEST(FileBus, ReadsBackWhatItWroteThenEnds) {
    test::ScratchFolder scratch;
    const std::string file = "file://" + (scratch.path() / "a.lcmlog").string();
    {
        Bus writer = open(file + "?mode=w");
        EXPECT_TRUE(writer.publish("A", kSmall));
        EXPECT_TRUE(writer.publish("B", Bytes(1000, 3)));
    }
    Bus reader = open(file + "?speed=0");
    Listener listener;
    ASSERT_TRUE(reader.subscribe(".*", 2000, listener.handler()));
    EXPECT_EQ(reader.dispatch(0), 2);
    EXPECT_EQ(reader.dispatch(0), -1);
    EXPECT_EQ(listener.channels, (std::vector<std::string>{"A", "B"}));
    EXPECT_EQ(listener.data[1], Bytes(1000, 3));
    EXPECT_FALSE(reader.publish("A", kSmall));
}

TEST(FileBus, HostileLengthEndsTheLogNotTheProcess) {
    test::ScratchFolder scratch;
    const auto file = scratch.path() / "hostile.lcmlog";
    // liblcm 1.3.1 adds 1 to the length 0x7fffffff of this event and writes through a null pointer.
    std::ofstream(file, std::ios::binary) << std::string("\xED\xA1\xDA\x01", 4) << std::string(16, '\0')
                                          << std::string("\0\0\0\1\x7f\xff\xff\xff", 8) << "A"
                                          << "data";
    Bus bus = open("file://" + file.string() + "?speed=0");
    Listener listener;
    ASSERT_TRUE(bus.subscribe(".*", 2000, listener.handler()));
    EXPECT_EQ(bus.dispatch(0), -1);
    EXPECT_TRUE(listener.channels.empty());
}

TEST(UdpmUrl, ReadsPortAndBuffer) {
    EXPECT_EQ(parse_udpm_url("udpm://").port, 7667);
    const UdpmUrl url = parse_udpm_url("udpm://239.255.76.67:7777?ttl=0&recv_buf_size=4096");
    EXPECT_EQ(url.port, 7777);
    EXPECT_EQ(url.recv_buf_size, 4096);
}

class UdpmBus : public testing::Test {
  protected:
    void SetUp() override { TERES_REQUIRE_PRIVATE_NETWORK(); }
};

TEST_F(UdpmBus, CarriesMessagesOfAnySizeBetweenTwoBuses) {
    Bus from = open(test::kLoopbackUrl), to = open(std::string(test::kLoopbackUrl) + "&recv_buf_size=2097152");
    Listener listener;
    ASSERT_TRUE(to.subscribe("IMAGE|A", 2'000'000, listener.handler()));
    Bytes image(921'600);
    for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint8_t>(i * 7);
    from.publish("A", kSmall);
    from.publish("IMAGE", image);
    dispatch_until(to, [&] { return listener.channels.size() == 2; });
    ASSERT_EQ(listener.channels, (std::vector<std::string>{"A", "IMAGE"}));
    EXPECT_EQ(listener.data[1], image);
    EXPECT_NEAR(static_cast<double>(listener.receive_us[0]), static_cast<double>(monotonic_us()), 5e6);
}

TEST_F(UdpmBus, GuardsItsSocket) {
    Bus bus = open(test::kLoopbackUrl);
    ASSERT_TRUE(bus.subscribe("A", 100, [](auto, auto, auto) {}));
    const UdpmGuard guard = guard_udpm_socket(test::kLoopbackUrl);
    EXPECT_EQ(guard.sockets, 1);
    EXPECT_EQ(guard.filtered, 1);
    EXPECT_GT(guard.recv_buffer.value_or(0), 0);
}

Bytes short_packet(const std::string& channel, const Bytes& payload) {
    Bytes packet;
    for (const int byte : {0x4c, 0x43, 0x30, 0x32, 0, 0, 0, 1}) packet.push_back(static_cast<std::uint8_t>(byte));
    packet.insert(packet.end(), channel.begin(), channel.end());
    packet.insert(packet.end(), payload.begin(), payload.end());
    return packet;
}

Bytes fragment(std::uint32_t sequence, std::uint32_t size, std::uint32_t offset, std::uint16_t number,
               std::uint16_t count, const std::string& channel) {
    Bytes packet;
    const auto put = [&](std::uint32_t value, int bytes) {
        for (int i = bytes - 1; i >= 0; --i) packet.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    };
    put(0x4c433033, 4);
    put(sequence, 4);
    put(size, 4);
    put(offset, 4);
    put(number, 2);
    put(count, 2);
    packet.insert(packet.end(), channel.begin(), channel.end());
    packet.resize(packet.size() + 50, 'x');
    return packet;
}

// What brings liblcm 1.3.1 down or near it (the offset that wraps is a SIGSEGV without the filter).
TEST_F(UdpmBus, SurvivesMalformedDatagrams) {
    Bus bus = open(test::kLoopbackUrl);
    Listener listener;
    ASSERT_TRUE(bus.subscribe("A", 100, listener.handler()));
    const std::string a("A\0", 2);
    std::vector<Bytes> packets = {
        {},
        {0x4c},
        {0x4c, 0x43, 0x30, 0x32, 0, 0, 0, 1},
        {0x4c, 0x43, 0x30, 0x33, 0, 0, 0, 1},
        short_packet("A", {}),                    // channel not terminated
        short_packet(std::string(200, 'A'), {}),  // channel too long
        short_packet(a, {}),
        short_packet(a, Bytes(101)),  // above the bound of the subscriber
        fragment(2, 100, 0, 0, 0, a),
        fragment(3, 100, 0, 0, 2, a),
        fragment(3, 100, 0, 0, 2, a),
        fragment(4, 1u << 28, 0, 0, 65535, a),
        fragment(5, 0xffffffff, 0, 0, 3, a),
        fragment(6, 100, 0, 0, 3, a),
        fragment(6, 100, 0xfffffff0, 1, 3, ""),
        fragment(6, 100, 0xffffffff, 2, 3, ""),
        fragment(7, 100, 90, 1, 2, ""),
        fragment(8, 100, 0, 0, 2, ""),  // channel not terminated
        fragment(9, 100, 0, 0, 2, std::string(200, 'A')),
    };
    // Cut anywhere, behind a whole one whose bytes liblcm still has in its buffer.
    for (std::size_t size = 8; size < 40; ++size) {
        packets.push_back(fragment(10, 100, 0, 0, 2, a));
        packets.push_back(Bytes(packets.back().begin(), packets.back().begin() + static_cast<std::ptrdiff_t>(size)));
        packets.push_back(fragment(10, 100, 0, 1, 2, a));
        packets.back().resize(size);
    }
    const int sender = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in group{};
    group.sin_family = AF_INET;
    group.sin_port = htons(7667);
    group.sin_addr.s_addr = htonl(test::kLcmGroupAddress);
    for (const Bytes& packet : packets)
        ASSERT_EQ(sendto(sender, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&group), sizeof group),
                  static_cast<ssize_t>(packet.size()));
    const Bytes last = short_packet(a, kSmall);
    sendto(sender, last.data(), last.size(), 0, reinterpret_cast<sockaddr*>(&group), sizeof group);
    close(sender);
    dispatch_until(bus, [&] { return !listener.data.empty() && listener.data.back() == kSmall; });
    ASSERT_FALSE(listener.data.empty());
    EXPECT_EQ(listener.data.back(), kSmall);
    EXPECT_EQ(bus.counters().refused, 1);
}

// liblcm would abort in select() on descriptor -1.
TEST_F(UdpmBus, SaysSoWhenItCannotHearItself) {
    Bus bus = open(test::kLoopbackUrl);
    ASSERT_TRUE(test::set_loopback(false));
    const Status status = bus.subscribe("A", 100, [](auto, auto, auto) {});
    ASSERT_TRUE(test::set_loopback(true));
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, ErrorKind::kHostFault);
    EXPECT_NE(status.error().text.find("route"), std::string::npos) << status.error().text;
    EXPECT_EQ(bus.dispatch(0), 0);
}

}  // namespace
}  // namespace teres
