// What the service alarms about, kept and diagnosed beside it.
#include <cstdio>
#include <filesystem>
#include <optional>
#include <utility>

#include "core/bus.h"
#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/clock.h"
#include "core/dated_path.h"
#include "core/service.h"
#include "teres/gap_t.hpp"
#include "tools/diagnose.h"
#include "tools/stream_window.h"

namespace teres::tools {
namespace {

constexpr std::size_t kLiveFrames = 60;  // of a window

// gaps/20261121-201500, -1, -2, ... if it is there already.
std::filesystem::path folder_of_now(const std::filesystem::path& parent) {
    const std::filesystem::path first = parent / dated("%Y%m%d-%H%M%S");
    std::filesystem::path folder = first;
    for (int k = 1; std::filesystem::exists(folder); ++k) folder = first.string() + "-" + std::to_string(k);
    return folder;
}

// The window of one alarm: kept as a case folder, the answer beside it.
Status diagnose_window(const DiagnoseOptions& options, const StreamWindow& window, std::int64_t onset_us) {
    const auto before_us = static_cast<std::int64_t>(1e6 * options.before_s);
    TERES_TRY_ASSIGN(Case c, window.cut(onset_us - before_us, kLiveFrames));
    const std::filesystem::path folder = folder_of_now(options.folder);
    c.name = folder.filename().string();
    TERES_TRY(write_case(c, folder));
    std::fprintf(stderr, "%s: %d frames, %.1f s; diagnosing\n", folder.c_str(), c.num_frames,
                 c.dt_s * (c.num_frames - 1));
    DiagnoseOptions one = options;
    one.cases = {folder.string()};
    one.json_file = folder / "gap.json";
    one.report_folder = folder / "report";
    TERES_TRY(diagnose(one));
    return {};
}

}  // namespace

// Waits for alarms of the service. What comes while a window is worked on is let pass: the bus never waits for anybody.
int diagnose_live(const DiagnoseOptions& options) {
    auto config = read_offline_settings(options.settings);
    if (!config) return report(config.error());
    const bool told = !options.settings.config_file.empty();  // the service's own settings
    const std::string url = told ? config->service().bus_url : options.url,
                      folder = options.cases.empty() ? config->service().case_folder.string() : options.cases.front();
    if (folder.empty())
        return report({ErrorKind::kInvalidInput,
                       "diagnose --live: no CASE is given and service.case of --config does not name one"});
    if (url.starts_with("memq://"))
        return report({ErrorKind::kInvalidInput,
                       "diagnose --live: memq:// cannot be heard from outside its process; "
                       "set service.bus_url to udpm://..."});
    auto base = read_case(folder);
    if (!base) return report(base.error());
    auto bus = Bus::open(url);
    if (!bus) return report(bus.error());
    StreamWindow window(std::move(*base), options.before_s + 2.0 * options.after_s);
    std::optional<std::int64_t> onset_us;  // of the alarm that is waited out
    bool alarmed = false;
    const auto hear = [&](const char* channel, auto message, auto take) {
        return bus->subscribe(
            channel, kMaxMessageBytes,
            [message, take](std::string_view, std::span<const std::uint8_t> data, std::int64_t) mutable {
                if (message.decode(data.data(), 0, static_cast<int>(data.size())) >= 0) take(message);
            });
    };
    for (const Status& heard : {hear("MARKERS", markers_t{}, [&](const markers_t& m) { window.add(m); }),
                                hear("TOOL_LOADS", tool_loads_t{}, [&](const tool_loads_t& m) { window.add(m); }),
                                hear("GAP", gap_t{}, [&](const gap_t& m) {
                                    if (m.alarm != 0 && !alarmed) onset_us = m.onset_stamp_us;
                                    alarmed = m.alarm != 0;
                                })})
        if (!heard) return report(heard.error());
    std::optional<StopSignals> signals(std::in_place);
    const auto after_us = static_cast<std::int64_t>(1e6 * options.after_s);
    std::fprintf(stderr, "waiting for alarms of GAP on %s; Ctrl-C ends\n", url.c_str());
    while (!signals->stop()) {
        if (bus->dispatch(100) < 0) return report({ErrorKind::kHostFault, "bus " + url + " failed"});
        if (!onset_us || window.newest_us() < *onset_us + after_us) continue;
        signals.reset();  // minutes of work: Ctrl-C ends it
        if (const Status done = diagnose_window(options, window, *std::exchange(onset_us, std::nullopt)); !done)
            report(done.error());
        signals.emplace();
        const std::int64_t until_us = monotonic_us() + 100'000;  // what has piled up is old
        while (monotonic_us() < until_us && bus->dispatch(0) > 0) {
        }
        onset_us.reset();
    }
    return kDone;
}

}  // namespace teres::tools
