#include "core/session.h"

#include <algorithm>
#include <set>

#include "core/clock.h"
#include "core/dated_path.h"
#include "core/log.h"

namespace teres {
namespace {

// A turn ends after this many rounds of dispatch and plugin steps even if somebody always has more to do.
constexpr int kMaxRounds = 64;
constexpr const char* kHealthChannel = "HEALTH";

struct LoadedUnit {
    const teres_factory* factory;
    ResolvedSettings settings;
};

std::string joined(const std::vector<std::string>& names) {
    std::string text;
    for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
    return text;
}

// The units that a list of the settings file names, each with its checked settings.
Result<std::vector<LoadedUnit>> load_units(const Config& config, const std::vector<std::string>& names,
                                           teres_unit_kind kind, std::span<const std::filesystem::path> folders) {
    std::vector<LoadedUnit> units;
    for (const std::string& name : names) {
        TERES_TRY_ASSIGN(const std::filesystem::path file, find_plugin(name, folders));
        TERES_TRY_ASSIGN(const PluginFile plugin, load_plugin(file));
        std::vector<const teres_factory*> wanted = plugin.factories;
        if (name.find('/') == std::string::npos) {
            wanted = {plugin.factory(name)};
            if (wanted.front() == nullptr) return invalid_input(file.string() + ": has no unit " + name);
        }
        for (const teres_factory* factory : wanted) {
            if (factory->kind != kind)
                return invalid_input(std::string("unit ") + factory->id + " is a " +
                                     (kind == TERES_UNIT_DRIVER ? "plugin: name it in service.plugins"
                                                                : "driver: name it in service.drivers"));
            TERES_TRY_ASSIGN(ResolvedSettings settings,
                             config.resolve(factory->id, std::span(factory->settings, factory->num_settings)));
            units.push_back({factory, std::move(settings)});
            log(Level::kDebug, "host", std::string(factory->id) + " " + plugin.version + " from " + file.string());
        }
    }
    return units;
}

// Sections of units that are not in use are checked as well, so that a typing error in them is found now.
Status check_other_sections(const Config& config, const std::set<std::string>& used,
                            std::span<const std::filesystem::path> folders) {
    std::vector<std::string> known = available_plugins(folders);
    known.insert(known.end(), used.begin(), used.end());
    known.emplace_back("service");
    for (const auto& [section, place] : config.sections()) {
        if (used.count(section) > 0) continue;
        if (std::find(known.begin(), known.end(), section) == known.end()) {
            const std::string meant = closest_name(section, known);
            return invalid_input(place + ": [" + section + "] is not a known section" +
                                 (meant.empty() ? "; there are: " + joined(known) : " (did you mean " + meant + "?)"));
        }
        TERES_TRY_ASSIGN(const std::filesystem::path file, find_plugin(section, folders));
        TERES_TRY_ASSIGN(const PluginFile plugin, load_plugin(file));
        const teres_factory* factory = plugin.factory(section);
        if (factory == nullptr)
            return invalid_input(place + ": [" + section + "]: " + file.string() + " has no such unit");
        TERES_TRY(config.resolve(section, std::span(factory->settings, factory->num_settings)));
    }
    return {};
}

struct LoadedUnits {
    std::vector<LoadedUnit> plugins, drivers;
};

Result<LoadedUnits> load_all(const Config& config) {
    const ServiceSettings& settings = config.service();
    const auto folders = plugin_folders(settings.plugin_folder);
    LoadedUnits units;
    TERES_TRY_ASSIGN(units.plugins, load_units(config, settings.plugins, TERES_UNIT_PLUGIN, folders));
    TERES_TRY_ASSIGN(units.drivers, load_units(config, settings.drivers, TERES_UNIT_DRIVER, folders));
    std::set<std::string> used;
    for (const auto* list : {&units.plugins, &units.drivers})
        for (const LoadedUnit& unit : *list)
            if (!used.insert(unit.factory->id).second)
                return invalid_input(std::string("unit ") + unit.factory->id + " is named twice in [service]");
    TERES_TRY(check_other_sections(config, used, folders));
    return units;
}

}  // namespace

Status Session::check(const Config& config) {
    TERES_TRY(load_all(config));
    return {};
}

Result<std::unique_ptr<Session>> Session::open(const Config& config) {
    const ServiceSettings& settings = config.service();
    // Plugins before the bus: its threads must not be there when a probe forks.
    TERES_TRY_ASSIGN(LoadedUnits units, load_all(config));
    std::unique_ptr<Session> session(new Session(settings));
    session->opened_us_ = monotonic_us();
    TERES_TRY_ASSIGN(session->bus_, Bus::open(settings.bus_url));
    TERES_TRY(session->open_recorder());
    for (auto* list : {&units.plugins, &units.drivers}) {
        auto& hosted = list == &units.plugins ? session->plugins_ : session->drivers_;
        for (LoadedUnit& loaded : *list) {
            TERES_TRY_ASSIGN(auto unit, HostedUnit::create(*loaded.factory, *session));
            hosted.push_back(std::move(unit));
            TERES_TRY(hosted.back()->configure(std::move(loaded.settings)));
        }
    }
    return session;
}

Session::~Session() {
    stop();
    // The later unit may hold an interface of the earlier one.
    while (!drivers_.empty()) drivers_.pop_back();
    while (!plugins_.empty()) plugins_.pop_back();
}

Status Session::open_recorder() {
    if (settings_.record_to.empty()) return {};
    RecorderSettings recording;
    recording.file = dated(settings_.record_to);
    recording.max_mb = static_cast<std::int64_t>(settings_.record_max_mb);
    recording.overwrite = settings_.record_overwrite;
    TERES_TRY_ASSIGN(recorder_, Recorder::open(recording));
    return bus_->subscribe(
        ".*", kMaxMessageBytes, [this](std::string_view channel, std::span<const std::uint8_t> data, std::int64_t) {
            // A replay is recorded on the clock of the recording: the same log every time.
            recorder_->record(channel, data, clock_ != nullptr ? clock_->now_us() : Recorder::wall_clock_us());
        });
}

Status Session::subscribe(const std::string& channel, std::size_t max_bytes, Bus::Handler handler) {
    return bus_->subscribe(channel, max_bytes, std::move(handler));
}

Status Session::start() {
    for (auto* list : {&plugins_, &drivers_}) {
        for (const auto& unit : *list) {
            if (Status started = unit->start(); !started) {
                silence(*unit);
                stop();
                return started;
            }
            if (unit->is_driver() && clock_ == nullptr)
                clock_ = static_cast<StreamClock*>(unit->extension(StreamClock::kId));
        }
    }
    return {};
}

int Session::drain() noexcept {
    int delivered = 0;
    for (int round = 0; round < kMaxRounds; ++round) {
        const int now = bus_->dispatch(0);
        if (now < 0) bus_ended_ = true;
        if (now <= 0) break;
        delivered += now;
    }
    return delivered;
}

bool Session::step_plugins() noexcept {
    bool worked = false;
    for (const auto& plugin : plugins_) {
        const teres_step_outcome outcome = plugin->step(now_us());
        worked |= outcome == TERES_STEP_DONE || outcome == TERES_STEP_DEGRADED;
    }
    return worked;
}

Turn Session::step() noexcept {
    const std::int64_t begin = monotonic_us();
    Turn turn;
    for (const auto& driver : drivers_) turn.worked |= driver->step(now_us()) != TERES_STEP_IDLE;
    bool drained = false;
    for (int round = 0; round < kMaxRounds && !drained; ++round) {
        const bool delivered = drain() > 0;
        const bool worked = step_plugins();
        drained = !delivered && !worked;
        turn.worked |= !drained;
    }
    ++iterations_;
    longest_turn_us_ = std::max(longest_turn_us_, monotonic_us() - begin);

    const auto has_ended = [](const auto& driver) { return driver->state() != UnitState::kRunning; };
    const bool streams_ended = drivers_.empty() ? bus_ended_ : std::all_of(drivers_.begin(), drivers_.end(), has_ended);
    turn.finished = streams_ended && drained;
    if (!turn.worked) {
        const int delivered = bus_->dispatch(static_cast<int>(settings_.idle_wait_ms));
        if (delivered < 0) bus_ended_ = true;
        turn.worked = delivered > 0;
    }
    return turn;
}

Status Session::run_until_finished(const std::function<bool()>& keep_going) {
    if (drivers_.empty()) return invalid_input("service.drivers is empty: nothing ever finishes");
    for (bool finished = false; !finished;) {
        finished = step().finished;
        if (const std::string unit = failed_unit(); !unit.empty())
            return host_fault("unit " + unit + " failed while running");
        if (keep_going && !keep_going()) break;
    }
    return {};
}

void Session::stop() noexcept {
    for (auto* list : {&drivers_, &plugins_}) {
        for (auto unit = list->rbegin(); unit != list->rend(); ++unit) {
            (*unit)->stop();
            silence(**unit);
        }
    }
    clock_ = nullptr;
    if (bus_) drain();  // what units said last goes to the recording and to the owner
    recorder_.reset();
}

std::string Session::failed_unit() const {
    for (const auto* list : {&plugins_, &drivers_})
        for (const auto& unit : *list)
            if (unit->state() == UnitState::kFailed) return unit->id();
    return {};
}

void Session::silence(const HostedUnit& unit) noexcept {
    for (Subscription& subscription : subscriptions_)
        if (subscription.unit == &unit) subscription.active = false;
}

bool Session::publish(HostedUnit&, const char* channel, const void* data, std::size_t size) noexcept {
    const std::span bytes(static_cast<const std::uint8_t*>(data), size);
    const bool sent = bus_->publish(channel, bytes);
    if (sent)
        traffic_.sent(channel, bytes, monotonic_us());
    else
        traffic_.refused(channel);
    return sent;
}

bool Session::subscribe(HostedUnit& unit, const char* channel, std::size_t max_bytes, teres_message_handler handler,
                        void* user) noexcept {
    try {
        const bool counts =
            std::find(counted_patterns_.begin(), counted_patterns_.end(), channel) == counted_patterns_.end();
        if (counts) counted_patterns_.emplace_back(channel);
        Subscription& added = subscriptions_.emplace_back(Subscription{this, &unit, handler, user, counts, true});
        const auto deliver = [&added](std::string_view name, std::span<const std::uint8_t> data,
                                      std::int64_t receive_us) {
            if (added.counts) added.session->traffic_.received(name, data, monotonic_us());
            if (!added.active) return;
            char text[256];  // zero-terminated for C; LCM's channel names are shorter than 64
            text[name.copy(text, sizeof(text) - 1)] = '\0';
            added.handler(added.user, text, data.data(), data.size(), receive_us);
        };
        const Status subscribed = bus_->subscribe(channel, max_bytes, deliver);
        if (subscribed) return true;
        added.active = false;
        log(Level::kError, unit.id(), subscribed.error().text);
    } catch (...) {
    }
    return false;
}

void* Session::find_extension(const char* extension_id) noexcept {
    for (auto* list : {&plugins_, &drivers_})
        for (const auto& unit : *list)
            if (void* found = unit->extension(extension_id)) return found;
    return nullptr;
}

void* Session::extension_for(HostedUnit&, const char* extension_id) noexcept {
    return find_extension(extension_id);
}

std::int64_t Session::now_us() const noexcept {
    return clock_ != nullptr ? clock_->now_us() : monotonic_us();
}

bool Session::publish_health() noexcept {
    try {
        const std::int64_t now = monotonic_us();
        const auto stale_after_us = static_cast<std::int64_t>(settings_.stale_after_s * 1e6);
        health_.header.capture_stamp_us = now;
        ++health_.header.sequence;
        health_.uptime_s = 1e-6 * static_cast<double>(now - opened_us_);
        health_.resident_memory_mb = memory_.resident_mb();
        health_.peak_memory_mb = memory_.peak_mb();
        health_.loop_iterations = iterations_;
        health_.loop_ms_max = 1e-3 * static_cast<double>(longest_turn_us_);
        longest_turn_us_ = 0;
        traffic_.report(health_.channels, now);
        if (const std::int64_t refused = bus_->counters().refused; refused > 0) {
            channel_health_t& bus = health_.channels.emplace_back();
            bus.channel = "(refused by the bus)";
            bus.age_s = -1.0;
            bus.dropped = refused;
        }
        if (recorder_) {
            const RecorderCounters counters = recorder_->counters();
            channel_health_t& log_file = health_.channels.emplace_back();
            log_file.channel = counters.stopped ? "(recording, stopped)" : "(recording)";
            log_file.age_s = -1.0;
            log_file.received = counters.written;
            log_file.dropped = counters.dropped;
        }
        health_.num_channels = static_cast<std::int32_t>(health_.channels.size());
        health_.units.clear();
        for (auto* list : {&drivers_, &plugins_}) {
            for (const auto& unit : *list) {
                unit_health_t& out = health_.units.emplace_back();
                out.unit = unit->id();
                out.state = state_word(*unit, now, stale_after_us);
                const StepTimes times = unit->take_times();
                out.step_ms_mean = times.steps_since > 0 ? 1e-3 * static_cast<double>(times.total_us_since) /
                                                               static_cast<double>(times.steps_since)
                                                         : 0.0;
                out.step_ms_max = 1e-3 * static_cast<double>(times.max_us_since);
                out.steps = times.steps;
                out.degraded_steps = times.degraded_steps;
            }
        }
        health_.num_units = static_cast<std::int32_t>(health_.units.size());
        health_bytes_.resize(static_cast<std::size_t>(health_.getEncodedSize()));
        if (health_.encode(health_bytes_.data(), 0, static_cast<int>(health_bytes_.size())) < 0) return false;
        return bus_->publish(kHealthChannel, health_bytes_);
    } catch (...) {
        return false;  // out of memory: the next one tells
    }
}

}  // namespace teres
