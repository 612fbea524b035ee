// teres record: writes what is on the bus to an LCM log.
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <optional>
#include <utility>

#include "core/bus.h"
#include "core/clock.h"
#include "core/dated_path.h"
#include "core/recorder.h"
#include "core/service.h"
#include "teres/pedal_t.hpp"
#include "tools/commands.h"
#include "tools/spy_table.h"

namespace teres::tools {
namespace {

struct RecordOptions {
    std::string url = kDefaultBusUrl;
    std::string channels = ".*";
    std::string file;
    std::int64_t split_mb = 0;
    int keep = 0;
    std::int64_t max_mb = 0;
    double seconds = 0.0;
    bool pedal = false;
    bool force = false;
};

// One log for each time between two steps on a pedal whose action is `record`; dated names unless -o holds a date
// itself.
int record_by_pedal(const RecordOptions& options, RecorderSettings settings, Bus& bus) {
    std::optional<Recorder> recorder;
    bool toggle = false;
    const std::int64_t start_us = monotonic_us();
    const Status heard = bus.subscribe(
        options.channels, kMaxMessageBytes,
        [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            if (recorder) recorder->record(channel, data, Recorder::wall_clock_us());
            pedal_t pedal;
            if (channel == "PEDAL" && pedal.decode(data.data(), 0, static_cast<int>(data.size())) >= 0)
                toggle |= pedal.down != 0 && pedal.action == "record";
        },
        kDeepQueue);
    if (!heard) return report(heard.error());
    const StopSignals signals;
    int logs = 0;
    while (!signals.stop() &&
           !(options.seconds > 0.0 && static_cast<double>(monotonic_us() - start_us) >= 1e6 * options.seconds)) {
        if (bus.dispatch(50) < 0) break;
        if (recorder && recorder->counters().stopped)
            std::fprintf(stderr, "teres: record: %s\n", recorder->stop_reason().c_str());
        if (!std::exchange(toggle, false) && !(recorder && recorder->counters().stopped)) continue;
        if (recorder) {
            recorder.reset();
            continue;
        }
        settings.file = dated(options.file.empty() ? "teres-%Y%m%d-%H%M%S.lcm" : options.file);
        auto opened = Recorder::open(settings);
        if (!opened) return report(opened.error());
        recorder.emplace(std::move(*opened));
        ++logs;
        std::fprintf(stderr, "recording to %s\n", settings.file.c_str());
    }
    std::fprintf(stderr, "%d logs\n", logs);
    return kDone;
}

int record(const RecordOptions& options) {
    if (options.url.starts_with("memq://"))
        return report({ErrorKind::kInvalidInput,
                       "record: memq:// cannot be heard from outside its process; use service.record_to in "
                       "the settings of the service"});
    RecorderSettings settings;
    settings.file = options.file.empty() ? dated("teres-%Y%m%d-%H%M%S.lcm") : std::filesystem::path(options.file);
    settings.split_mb = options.split_mb;
    settings.keep = options.keep;
    settings.max_mb = options.max_mb;
    settings.overwrite = options.force;
    auto bus = Bus::open(options.url);
    if (!bus) return report(bus.error());
    if (options.pedal) return record_by_pedal(options, settings, *bus);
    auto recorder = Recorder::open(settings);
    if (!recorder) return report(recorder.error());
    SpyTable gaps;  // what was lost before it came here
    const Status subscribed = bus->subscribe(
        options.channels, kMaxMessageBytes,
        [&](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            recorder->record(channel, data, Recorder::wall_clock_us());
            gaps.add(channel, data, monotonic_us());
        },
        kDeepQueue);
    if (!subscribed) return report(subscribed.error());

    const StopSignals signals;
    const bool show = isatty(STDERR_FILENO) != 0;
    std::fprintf(stderr, "recording %s to %s; Ctrl-C ends\n", options.url.c_str(), settings.file.c_str());
    const std::int64_t start_us = monotonic_us();
    std::int64_t next_us = start_us + 1'000'000;
    const auto over = [&] {
        return options.seconds > 0.0 && static_cast<double>(monotonic_us() - start_us) >= 1e6 * options.seconds;
    };
    while (!signals.stop() && !over() && !recorder->counters().stopped) {
        if (bus->dispatch(50) < 0) break;
        if (!show || monotonic_us() < next_us) continue;
        const RecorderCounters c = recorder->counters();
        std::fprintf(stderr, "\r%8.0f s %10lld messages %10.1f MB %8lld dropped ",
                     static_cast<double>(monotonic_us() - start_us) * 1e-6, static_cast<long long>(c.written),
                     static_cast<double>(c.written_bytes) * 1e-6, static_cast<long long>(c.dropped));
        next_us += 1'000'000;
    }
    recorder->flush();
    const RecorderCounters counters = recorder->counters();
    const std::string reason = recorder->stop_reason();
    std::int64_t lost = 0;
    for (const SpyRow& row : gaps.rows(monotonic_us())) lost += row.lost;
    std::fprintf(stderr, "%s%lld messages, %lld bytes in %s; %lld dropped, %lld lost before they came here\n",
                 show ? "\n" : "", static_cast<long long>(counters.written),
                 static_cast<long long>(counters.written_bytes), settings.file.c_str(),
                 static_cast<long long>(counters.dropped), static_cast<long long>(lost));
    if (counters.stopped)
        return report({options.max_mb > 0 ? ErrorKind::kNotUsable : ErrorKind::kHostFault, "record: " + reason});
    if (counters.written == 0)
        return report(
            {ErrorKind::kNotUsable, "record: no message on " + options.url + " (channels '" + options.channels + "')"});
    return kDone;
}

}  // namespace

void add_record_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<RecordOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "record", "Record the bus to an LCM log (as lcm-logger writes it)",
                 "  teres record -o session.lcm\n"
                 "  teres record --channels 'MARKERS|TOOL_LOADS' --seconds 60\n"
                 "  teres record --split-mb 500 --keep 20 -o /var/log/teres/session.lcm   # files .00, .01, ...\n"
                 "  teres record --pedal -o '/var/lib/teres/%Y%m%d-%H%M%S.lcm'             # from step to step on the "
                 "footswitch\n"
                 "Exit code 1: nothing came, or --max-mb was reached; 3: the disk is full.",
                 [options] { return record(*options); });
    verb->add_option("--url", options->url, "LCM URL of the bus")->envname("LCM_DEFAULT_URL")->capture_default_str();
    verb->add_option("-o,--output", options->file, "Log file; default teres-<date>-<time>.lcm")->type_name("FILE");
    verb->add_option("--channels", options->channels, "Expression over the whole channel name")->capture_default_str();
    verb->add_option("--split-mb", options->split_mb,
                     "Start a new file FILE.00, FILE.01, ... at this size; 0: one file")
        ->check(CLI::Range(0, 1'000'000));
    verb->add_option("--keep", options->keep, "With --split-mb: keep only the newest files; 0: all")
        ->check(CLI::Range(0, 100'000));
    verb->add_option("--max-mb", options->max_mb, "Stop at this size; 0: no limit")->check(CLI::Range(0, 100'000'000));
    verb->add_option("--seconds", options->seconds, "End after this time; 0: when stopped")
        ->check(CLI::Range(0.0, 1e7));
    verb->add_flag("--pedal", options->pedal,
                   "Start and stop with the pedal whose action is `record`; FILE may hold a date");
    verb->add_flag("--force", options->force, "Overwrite an existing log");
}

}  // namespace teres::tools
