// teres bridge: shows the appliance's bus to a laptop, one way.
#include <cstdio>
#include <memory>

#include "core/bus.h"
#include "core/clock.h"
#include "core/service.h"
#include "tools/commands.h"
#include "tools/republisher.h"

namespace teres::tools {
namespace {

struct BridgeOptions {
    std::string url = kDefaultBusUrl;
    std::string channels = ".*";
    std::string interface;
    std::string group = "239.255.76.68:7668";
    int hops = 1;
    bool images = false;
    double seconds = 0.0;
    RepublishLimits limits;
};

int bridge(const BridgeOptions& options) {
    auto republisher = Republisher::open(options.interface, options.group, options.hops, options.limits);
    if (!republisher) return report(republisher.error());
    auto bus = Bus::open(options.url);
    if (!bus) return report(bus.error());
    const Status heard =
        bus->subscribe(options.channels, kMaxMessageBytes,
                       [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
                           const bool image = channel.starts_with("CAMERA_") && !channel.ends_with("_INFO");
                           if (image && !options.images) return;
                           republisher->message(channel, data, monotonic_us());
                       });
    if (!heard) return report(heard.error());
    std::fprintf(stderr, "republishing on %s to %s; there: teres spy --url 'udpm://%s?ttl=1'\n",
                 options.interface.c_str(), options.group.c_str(), options.group.c_str());
    const StopSignals signals;
    const std::int64_t end_us = monotonic_us() + static_cast<std::int64_t>(1e6 * options.seconds);
    while (!signals.stop() && (options.seconds <= 0.0 || monotonic_us() < end_us))
        if (bus->dispatch(50) < 0) return report({ErrorKind::kHostFault, "bridge: bus " + options.url + " failed"});
    const auto& c = republisher->counters();
    std::fprintf(stderr, "%lld messages sent, %lld held back by the limits, %lld failed\n",
                 static_cast<long long>(c.sent), static_cast<long long>(c.held_back), static_cast<long long>(c.failed));
    return kDone;
}

}  // namespace

void add_bridge_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<BridgeOptions>();
    CLI::App* verb = add_verb(
        app, exit_code, "bridge", "Republish the bus on an interface: one way, rate-limited, without images",
        "  teres bridge --interface eth1\n"
        "  teres bridge --interface eth1 --channels 'HEALTH|DEVICE_HEALTH|BOUNDARY_ESTIMATE' --messages-per-s 2\n"
        "  systemctl start teres-bridge@eth1          # on the appliance\n"
        "On the laptop: ip route add 239.255.76.68/32 dev eth0; teres spy --url 'udpm://239.255.76.68:7668?ttl=1'",
        [options] { return bridge(*options); });
    verb->add_option("--interface", options->interface, "Interface that the messages leave by")->required();
    verb->add_option("--url", options->url, "LCM URL of the bus")->envname("LCM_DEFAULT_URL")->capture_default_str();
    verb->add_option("--channels", options->channels, "Expression over the whole channel name")->capture_default_str();
    verb->add_flag("--images", options->images, "Images as well, as far as the limits let them pass");
    verb->add_option("--group", options->group, "Multicast address and port")->capture_default_str();
    verb->add_option("--hops", options->hops, "Networks that the packets may cross (TTL)")
        ->check(CLI::Range(0, 8))
        ->capture_default_str();
    verb->add_option("--messages-per-s", options->limits.messages_per_s, "Per channel")
        ->check(CLI::Range(0.01, 1000.0))
        ->capture_default_str();
    verb->add_option("--bytes-per-s", options->limits.bytes_per_s, "Over all channels")
        ->check(CLI::Range(1e3, 1e9))
        ->capture_default_str();
    verb->add_option("--seconds", options->seconds, "End after this time; 0: when stopped")
        ->check(CLI::Range(0.0, 1e7));
}

}  // namespace teres::tools
