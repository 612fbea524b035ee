// teres spy: what is on the bus. Runs on the appliance (no display, loopback only), where lcm-spy does not.
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdio>
#include <memory>

#include "core/bus.h"
#include "core/clock.h"
#include "core/service.h"
#include "tools/commands.h"
#include "tools/message_fields.h"
#include "tools/spy_table.h"

namespace teres::tools {
namespace {

struct SpyOptions {
    std::string url = kDefaultBusUrl;
    std::string channels = ".*";
    double seconds = 0.0;  // 0: until stopped
    bool once = false;
    bool json = false;
    bool lines = false;
};

std::size_t terminal_columns() {
    winsize size{};
    return isatty(STDOUT_FILENO) != 0 && ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col
                                                                                                         : 200;
}

void print(const SpyTable& table, const SpyOptions& options, bool in_place) {
    const auto rows = table.rows(monotonic_us());
    if (options.json)
        std::printf("%s\n", as_json(rows).c_str());
    else if (in_place)  // home, then each line cleared to its end, then everything below
        std::printf("\033[H\033[2J%s   (Ctrl-C ends)\n%s", options.url.c_str(),
                    as_text(rows, terminal_columns()).c_str());
    else
        std::printf("%s\n", as_text(rows, terminal_columns()).c_str());
    std::fflush(stdout);
}

void print_line(std::string_view channel, std::span<const std::uint8_t> data) {
    std::printf("%.3f %s %s\n", 1e-6 * static_cast<double>(monotonic_us()), printable(channel).c_str(),
                one_line(message_fields(data).values).c_str());
    std::fflush(stdout);
}

int spy(const SpyOptions& options) {
    if (options.url.starts_with("memq://"))
        return report({ErrorKind::kInvalidInput,
                       "spy: memq:// cannot be seen from outside its process; start the service with "
                       "--set service.bus_url=" +
                           std::string(kDefaultBusUrl)});
    auto bus = Bus::open(options.url);
    if (!bus) return report(bus.error());
    SpyTable table;
    const Status subscribed = bus->subscribe(
        options.channels, kMaxMessageBytes,
        [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            table.add(channel, data, monotonic_us());
            if (options.lines) print_line(channel, data);
        },
        kDeepQueue);
    if (!subscribed) return report(subscribed.error());

    const StopSignals signals;
    const double seconds = options.seconds > 0.0 ? options.seconds : options.once ? 1.0 : 0.0;
    const bool in_place = !options.json && !options.once && isatty(STDOUT_FILENO) != 0;
    const std::int64_t period_us = in_place ? 500'000 : 1'000'000;
    const std::int64_t start_us = monotonic_us();
    std::int64_t next_us = start_us + period_us;
    const auto over = [&] { return seconds > 0.0 && static_cast<double>(monotonic_us() - start_us) >= 1e6 * seconds; };
    bool ended = false;
    while (!signals.stop() && !over() && !ended) {
        ended = bus->dispatch(50) < 0;
        if (options.once || options.lines || monotonic_us() < next_us) continue;
        print(table, options, in_place);
        next_us += period_us;
    }
    if (options.once || (ended && !options.lines)) print(table, options, false);
    if (table.messages() == 0)
        return report(
            {ErrorKind::kNotUsable, "spy: no message on " + options.url + " (channels '" + options.channels + "')"});
    return kDone;
}

}  // namespace

void add_spy_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<SpyOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "spy", "Look at the bus: channels, rates, sizes, jitter, gaps, decoded fields",
                 "  teres spy\n"
                 "  teres spy --once --json | jq '.channels[] | {channel, rate_hz, lost}'\n"
                 "  teres spy --url 'udpm://239.255.76.67:7667?ttl=0&recv_buf_size=16777216' --seconds 10\n"
                 "  teres spy --lines --channels 'DEVICE_HEALTH|PEDAL'\n"
                 "  teres spy --url 'file:///tmp/session.lcm?speed=0'\n"
                 "Exit code 1: no message came.",
                 [options] { return spy(*options); });
    verb->add_option("--url", options->url, "LCM URL of the bus")->envname("LCM_DEFAULT_URL")->capture_default_str();
    verb->add_option("--channels", options->channels, "Expression over the whole channel name")->capture_default_str();
    verb->add_option("--seconds", options->seconds, "End after this time; 0: when stopped")
        ->check(CLI::Range(0.0, 1e7));
    verb->add_flag("--once", options->once, "Watch one second (or --seconds), print one table");
    verb->add_flag("--json", options->json, "One JSON object per second instead of a table");
    verb->add_flag("--lines", options->lines, "One line per message: monotonic clock [s], channel, fields")
        ->excludes("--once", "--json");
}

}  // namespace teres::tools
