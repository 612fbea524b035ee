#include "core/hosted_unit.h"

#include <algorithm>
#include <array>
#include <exception>

#include "core/clock.h"
#include "core/log.h"

namespace teres {
namespace {

HostedUnit& unit_of(void* context) {
    return *static_cast<HostedUnit*>(context);
}

void host_log(void* context, std::int32_t level, const char* source, const char* text) {
    const bool known = level >= TERES_LOG_DEBUG && level <= TERES_LOG_ERROR;
    try {
        log(known ? static_cast<Level>(level) : Level::kError, source != nullptr ? source : unit_of(context).id(),
            text != nullptr ? text : "");
    } catch (...) {  // a log line lost is better than an exception across the boundary
    }
}

}  // namespace

HostedUnit::HostedUnit(const teres_factory& factory, UnitServices& services)
    : factory_(factory), services_(services), id_(factory.id) {
    host_.struct_size = sizeof(host_);
    host_.context = this;
    host_.log = &host_log;
    host_.publish = [](void* context, const char* channel, const void* data, std::size_t size) -> std::int32_t {
        HostedUnit& unit = unit_of(context);
        if (channel == nullptr || (data == nullptr && size > 0)) return -1;
        return unit.services_.publish(unit, channel, data, size) ? 0 : -1;
    };
    host_.subscribe = [](void* context, const char* channel, std::size_t max_bytes, teres_message_handler handler,
                         void* user) -> std::int32_t {
        HostedUnit& unit = unit_of(context);
        if (channel == nullptr || handler == nullptr) return -1;
        return unit.services_.subscribe(unit, channel, max_bytes, handler, user) ? 0 : -1;
    };
    host_.extension = [](void* context, const char* extension_id) -> void* {
        HostedUnit& unit = unit_of(context);
        return extension_id != nullptr ? unit.services_.extension_for(unit, extension_id) : nullptr;
    };
    host_.now_us = [](void* context) { return unit_of(context).services_.now_us(); };
}

Result<std::unique_ptr<HostedUnit>> HostedUnit::create(const teres_factory& factory, UnitServices& services) {
    std::unique_ptr<HostedUnit> unit(new HostedUnit(factory, services));
    try {
        unit->self_ = factory.create(&unit->host_);
    } catch (...) {
    }
    if (unit->self_ == nullptr) return host_fault("unit " + unit->id_ + ": its factory gave no unit");
    return unit;
}

HostedUnit::~HostedUnit() {
    if (self_ == nullptr) return;
    stop();
    try {
        factory_.destroy(self_);
    } catch (...) {
    }
}

Status HostedUnit::failed(const std::string& text, ErrorKind kind) noexcept {
    state_ = UnitState::kFailed;
    return tl::unexpected(Error{kind, "unit " + id_ + ": " + text});
}

// configure and start: the unit tells a kind and a text; an unknown kind counts as a host fault.
template <class Call>
Status HostedUnit::set_up(const char* what, Call&& call) {
    std::array<char, 2048> text{};
    std::int32_t kind = 0;
    try {
        kind = call(text.data(), text.size());
    } catch (const std::exception& error) {
        return failed(std::string(what) + " threw: " + error.what(), ErrorKind::kHostFault);
    } catch (...) {
        return failed(std::string(what) + " threw", ErrorKind::kHostFault);
    }
    if (kind == 0) return {};
    text.back() = '\0';
    const bool known = kind >= 1 && kind <= 3;
    return failed(text.front() != '\0' ? text.data() : std::string(what) + " failed and gave no reason",
                  known ? static_cast<ErrorKind>(kind) : ErrorKind::kHostFault);
}

Status HostedUnit::configure(ResolvedSettings settings) {
    settings_ = std::move(settings);  // kept: the unit may hold on to the texts
    TERES_TRY(set_up("configure", [&](char* error, std::size_t size) {
        return factory_.configure(self_, settings_.values.data(), settings_.values.size(), error, size);
    }));
    state_ = UnitState::kConfigured;
    return {};
}

Status HostedUnit::start() {
    TERES_TRY(set_up("start", [&](char* error, std::size_t size) { return factory_.start(self_, error, size); }));
    state_ = UnitState::kRunning;
    started_ = true;
    return {};
}

teres_step_outcome HostedUnit::step(std::int64_t now_us) noexcept {
    if (state_ != UnitState::kRunning) return TERES_STEP_IDLE;
    const std::int64_t begin = monotonic_us();
    std::int32_t outcome = TERES_STEP_IDLE;
    bool threw = false;
    try {
        outcome = factory_.step(self_, now_us);
    } catch (...) {
        threw = true;
    }
    if (threw || outcome < TERES_STEP_IDLE || outcome > TERES_STEP_FINISHED) {
        state_ = UnitState::kFailed;
        log(Level::kError, id_,
            threw ? "step threw; the unit is not stepped any more"
                  : "step returned an unknown outcome; the unit is not stepped any more");
        return TERES_STEP_IDLE;
    }
    if (outcome == TERES_STEP_FINISHED) state_ = UnitState::kFinished;
    if (outcome == TERES_STEP_IDLE) return TERES_STEP_IDLE;

    const std::int64_t end = monotonic_us();
    const std::int64_t took_us = end - begin;
    ++times_.steps;
    ++times_.steps_since;
    times_.total_us_since += took_us;
    times_.max_us_since = std::max(times_.max_us_since, took_us);
    if (outcome == TERES_STEP_DEGRADED) ++times_.degraded_steps;
    times_.degraded = outcome == TERES_STEP_DEGRADED;
    times_.last_work_us = end;
    return static_cast<teres_step_outcome>(outcome);
}

void HostedUnit::stop() noexcept {
    if (!started_) return;
    started_ = false;
    if (state_ != UnitState::kFailed) state_ = UnitState::kStopped;
    try {
        factory_.stop(self_);
    } catch (...) {
    }
}

void* HostedUnit::extension(const char* extension_id) noexcept {
    const bool running = state_ == UnitState::kRunning || state_ == UnitState::kFinished;
    if (!running || factory_.extension == nullptr) return nullptr;
    try {
        return factory_.extension(self_, extension_id);
    } catch (...) {
        return nullptr;
    }
}

StepTimes HostedUnit::take_times() noexcept {
    const StepTimes taken = times_;
    times_.steps_since = times_.total_us_since = times_.max_us_since = 0;
    return taken;
}

}  // namespace teres
