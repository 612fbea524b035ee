// teres replay: a recorded stream through the same plugins as the service, and the fingerprint of what they
// published.
#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "core/channel_pattern.h"
#include "core/clock.h"
#include "core/message_stamp.h"
#include "core/service.h"
#include "core/session.h"
#include "tools/commands.h"
#include "tools/replay_book.h"

namespace teres::tools {
namespace {

struct ReplayOptions {
    SettingsOptions settings;
    std::filesystem::path source;
    std::filesystem::path case_folder;
    double speed = 1.0;
};

// What a replay means, above the settings file and below what the user gives by --set.
Result<Config> replay_config(const ReplayOptions& options, bool is_case) {
    SettingsOptions settings = options.settings;
    const std::filesystem::path source = std::filesystem::absolute(options.source);
    std::vector<std::string> forced = {"service.drivers=replay",
                                       "service.bus_url=memq://",
                                       "service.record_to=",
                                       "replay.loop=false",
                                       fmt::format("replay.speed={}", options.speed),
                                       is_case ? "service.case=" + source.string() : "replay.log=" + source.string()};
    if (is_case) {
        forced.push_back("replay.case=" + source.string());
        forced.push_back("replay.log=");
    } else if (!options.case_folder.empty()) {
        forced.push_back("service.case=" + std::filesystem::absolute(options.case_folder).string());
    }
    settings.overrides.insert(settings.overrides.begin(), forced.begin(), forced.end());
    return read_settings(settings);
}

void print_summary(const ReplayBook& book, const Session& session, double seconds) {
    std::printf("%-20s %10s %14s\n", "channel", "messages", "bytes");
    for (const auto& [channel, traffic] : book.channels())
        std::printf("%-20s %10lld %14lld%s\n", channel.c_str(), static_cast<long long>(traffic.messages),
                    static_cast<long long>(traffic.bytes), traffic.input ? "  input" : "");
    for (const auto* list : {&session.drivers(), &session.plugins()})
        for (const auto& unit : *list)
            if (unit->times().degraded_steps > 0)
                std::printf("unit %s: %lld of %lld steps degraded\n", unit->id().c_str(),
                            static_cast<long long>(unit->times().degraded_steps),
                            static_cast<long long>(unit->times().steps));
    for (const ReplayBook::Comparison& c : book.compare())
        std::printf("compared with the log: %s %lld recorded, %lld replayed, %lld identical\n", c.channel.c_str(),
                    static_cast<long long>(c.recorded), static_cast<long long>(c.replayed),
                    static_cast<long long>(c.identical));
    std::printf("%.3f s of recording in %.3f s\n", book.recorded_s(), seconds);
    std::printf("run hash: %s\n", book.hash().c_str());
}

int replay(const ReplayOptions& options) {
    std::error_code failure;
    const bool is_case = std::filesystem::is_directory(options.source, failure);
    if (!is_case && !std::filesystem::is_regular_file(options.source, failure))
        return report({ErrorKind::kInvalidInput,
                       "replay: " + options.source.string() + " is neither a case folder nor a log file"});
    if (is_case && !options.case_folder.empty())
        return report({ErrorKind::kInvalidInput,
                       "replay: --case goes with a log; " + options.source.string() + " is a case itself"});
    const auto config = replay_config(options, is_case);
    if (!config) return report(config.error());
    ReplayBook book;
    if (!is_case)
        if (const Status read = book.read_results(options.source); !read) return report(read.error());

    auto session = Session::open(*config);
    if (!session) return report(session.error());
    const Status heard = (*session)->subscribe(
        ".*", kMaxMessageBytes, [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            book.add(channel, data, monotonic_us());
        });
    if (!heard) return report(heard.error());
    if (const Status started = (*session)->start(); !started) return report(started.error());

    const StopSignals signals;
    const bool show = isatty(STDERR_FILENO) != 0;
    const std::int64_t start_us = monotonic_us();
    std::int64_t next_us = start_us + 500'000;
    const Status run = (*session)->run_until_finished([&] {
        if (show && monotonic_us() >= next_us) {
            next_us += 500'000;
            std::fprintf(stderr, "\r%.1f s of recording, %lld messages ", book.recorded_s(),
                         static_cast<long long>(book.messages()));
        }
        return !signals.stop();
    });
    (*session)->stop();
    if (show) std::fprintf(stderr, "\r\033[K");
    print_summary(book, **session, static_cast<double>(monotonic_us() - start_us) * 1e-6);
    if (options.speed > 0.0 && std::isfinite(book.latency_ms(0.5, options.speed)))
        std::printf("capture to estimate: %.1f ms median, %.1f ms p95, %.1f ms p99, %.1f ms worst\n",
                    book.latency_ms(0.5, options.speed), book.latency_ms(0.95, options.speed),
                    book.latency_ms(0.99, options.speed), book.latency_ms(1.0, options.speed));
    if (!run) return report(run.error());
    if (signals.stop()) return report({ErrorKind::kNotUsable, "replay: stopped before the end of the recording"});
    return kDone;
}

}  // namespace

void add_replay_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<ReplayOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "replay", "Play a recording through the same plugins as the service",
                 "  teres replay config/cases/demo --speed 0\n"
                 "  teres replay session.lcm --case config/cases/demo --speed 0    # a log; the case gives "
                 "body and loads\n"
                 "  teres replay session.lcm --set service.record_to=again.lcm\n"
                 "With --speed 0 every run with the same settings publishes the same bits: compare the run "
                 "hash (FNV-1a, 64 bit,\n"
                 "over channel and bytes of all that the plugins publish; HEALTH and the inputs MARKERS, "
                 "TOOL_LOADS, CAMERA_*,\n"
                 "PEDAL are left out). Results in a log are not played; they are compared with what the "
                 "plugins publish now.",
                 [options] { return replay(*options); });
    verb->add_option("source", options->source, "LCM log or case folder")->required()->type_name("LOG|CASE");
    verb->add_option("--case", options->case_folder, "Case folder that a log belongs to (sets service.case)")
        ->type_name("FOLDER");
    verb->add_option("--speed", options->speed, "Factor on real time; 0: as fast as possible, bit-reproducible")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 1000.0));
    add_settings_options(*verb, options->settings);
}

}  // namespace teres::tools
