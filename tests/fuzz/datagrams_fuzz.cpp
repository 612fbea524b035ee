// What anybody can send to the bus's port: raw datagrams, and heads of whole messages and of fragments with the
// fuzzer's numbers. In a network namespace of its own; the bus must go on delivering. liblcm is not instrumented, its
// copies are checked by AddressSanitizer.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "core/bus.h"
#include "core/check.h"
#include "tests/support/private_network.h"

namespace {

using Bytes = std::vector<std::uint8_t>;

struct Victim {
    Victim() {
        if (const std::string& reason = teres::test::enter_private_network(); !reason.empty()) {
            std::fprintf(stderr, "%s\n", reason.c_str());
            std::exit(3);
        }
        sender = socket(AF_INET, SOCK_DGRAM, 0);
        group.sin_family = AF_INET;
        group.sin_port = htons(7667);
        group.sin_addr.s_addr = htonl(teres::test::kLcmGroupAddress);
        auto opened = teres::Bus::open(teres::test::kLoopbackUrl);
        TERES_CHECK(opened);
        bus = new teres::Bus(std::move(*opened));
        TERES_CHECK(
            bus->subscribe(".*", 1000, [this](std::string_view channel, std::span<const std::uint8_t> data, auto) {
                TERES_CHECK(data.size() <= 1000);
                if (channel == "ALIVE") ++alive;
            }));
    }
    void send(const Bytes& packet) {
        sendto(sender, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&group), sizeof group);
    }

    int sender = -1;
    sockaddr_in group{};
    teres::Bus* bus = nullptr;
    long alive = 0, runs = 0;
};

// Input: datagrams, each of kind, length, bytes.
void send_all(Victim& victim, const std::uint8_t* data, std::size_t size) {
    while (size >= 2) {
        const std::size_t length = std::min<std::size_t>(data[1], size - 2);
        Bytes packet;
        if (data[0] % 3 != 0) packet = {0x4c, 0x43, 0x30, static_cast<std::uint8_t>(data[0] % 3 == 1 ? 0x32 : 0x33)};
        packet.insert(packet.end(), data + 2, data + 2 + length);
        // The size that fragments announce stays below what would only measure the machine's memory.
        if (data[0] % 3 == 2 && packet.size() > 9 && data[0] % 2 == 0) packet[8] = 0, packet[9] &= 0x0f;
        victim.send(packet);
        data += 2 + length;
        size -= 2 + length;
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static Victim victim;
    send_all(victim, data, size);
    victim.bus->dispatch(0);
    if (++victim.runs % 1000 != 0) return 0;
    const long before = victim.alive;
    for (int attempt = 0; attempt < 50 && victim.alive == before; ++attempt) {
        victim.bus->publish("ALIVE", Bytes(8));
        victim.bus->dispatch(100);
    }
    TERES_CHECK(victim.alive > before);
    return 0;
}
