#include "core/service.h"

#include <sys/mman.h>
#include <csignal>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "core/clock.h"
#include "core/log.h"
#include "core/manager_link.h"
#include "core/session.h"

namespace teres {
namespace {

constexpr int kManagerWaitMs = 1000;  // for READY=1 and STOPPING=1, outside of the loop

std::atomic<bool> g_stop{false};  // the only thing a signal handler may touch
struct sigaction g_before_term, g_before_int;

void tell_status(ManagerLink& manager, const health_t& health) noexcept {
    char text[256];
    std::int64_t degraded = 0;
    for (const unit_health_t& unit : health.units) degraded += unit.degraded_steps;
    std::snprintf(text, sizeof(text), "STATUS=up %.0f s, %d units, %lld degraded steps, loop %.1f ms at most, %.0f MB",
                  health.uptime_s, health.num_units, static_cast<long long>(degraded), health.loop_ms_max,
                  health.resident_memory_mb);
    manager.tell(text);
}

std::string unit_names(const Session& session) {
    std::string text;
    for (const auto* list : {&session.drivers(), &session.plugins()})
        for (const auto& unit : *list) text += (text.empty() ? "" : ", ") + unit->id();
    return text;
}

}  // namespace

StopSignals::StopSignals() {
    g_stop = false;
    struct sigaction action {};
    action.sa_handler = [](int) { g_stop = true; };  // no SA_RESTART: a waiting poll returns at once
    sigemptyset(&action.sa_mask);
    sigaction(SIGTERM, &action, &g_before_term);
    sigaction(SIGINT, &action, &g_before_int);
}

StopSignals::~StopSignals() {
    sigaction(SIGTERM, &g_before_term, nullptr);
    sigaction(SIGINT, &g_before_int, nullptr);
}

const std::atomic<bool>& StopSignals::stop() const {
    return g_stop;
}

Status run_service(const Config& config, const std::atomic<bool>& stop) {
    const ServiceSettings& settings = config.service();
    ManagerLink manager(settings.watchdog);
    manager.tell("STATUS=loading units");
    TERES_TRY_ASSIGN(const std::unique_ptr<Session> session, Session::open(config));
    if (settings.lock_memory && mlockall(MCL_CURRENT | MCL_FUTURE) != 0)
        return host_fault(std::string("service.lock_memory: mlockall refused (") + std::strerror(errno) +
                          "); raise LimitMEMLOCK of the service or set it to false");
    TERES_TRY(session->start());
    log(Level::kInfo, "service", "running: " + unit_names(*session) + " over " + settings.bus_url);
    manager.tell("READY=1\nSTATUS=running", kManagerWaitMs);

    const auto health_period_us = static_cast<std::int64_t>(settings.health_period_s * 1e6);
    std::int64_t next_health_us = monotonic_us();
    std::string failure;
    const char* why = "told to";
    while (!stop) {
        const Turn turn = session->step();
        const std::int64_t now = monotonic_us();
        manager.ping(now);
        if (health_period_us > 0 && now >= next_health_us) {
            session->publish_health();
            tell_status(manager, session->health());
            next_health_us = now + health_period_us;
        }
        if (session->bus_failed()) failure = "bus " + settings.bus_url + " failed";
        if (const std::string unit = session->failed_unit(); !unit.empty())
            failure = "unit " + unit + " failed while running";
        if (!failure.empty()) {
            why = failure.c_str();
            break;
        }
        if (turn.finished && settings.stop_when_finished) {
            why = "the recording has ended";
            break;
        }
    }
    manager.tell("STOPPING=1", kManagerWaitMs);
    log(Level::kInfo, "service", std::string("stopping: ") + why);
    if (health_period_us > 0) session->publish_health();
    session->stop();
    if (!failure.empty()) return host_fault(failure);
    return {};
}

}  // namespace teres
