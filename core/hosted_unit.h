// One unit (plugin or driver) inside the host: its life, the services it may call, its step times. A unit
// that throws, answers nonsense or fails to start is stopped and marked; it does not take the host along.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "core/config.h"
#include "core/plugin.h"
#include "core/result.h"

namespace teres {

class HostedUnit;

/// What stands behind teres_host; implemented by the session.
class UnitServices {
  public:
    virtual bool publish(HostedUnit& unit, const char* channel, const void* data, std::size_t size) noexcept = 0;
    virtual bool subscribe(HostedUnit& unit, const char* channel, std::size_t max_bytes, teres_message_handler handler,
                           void* user) noexcept = 0;
    virtual void* extension_for(HostedUnit& unit, const char* extension_id) noexcept = 0;
    virtual std::int64_t now_us() const noexcept = 0;

  protected:
    ~UnitServices() = default;
};

enum class UnitState { kCreated, kConfigured, kRunning, kFinished, kStopped, kFailed };

struct StepTimes {
    std::int64_t steps = 0;
    std::int64_t degraded_steps = 0;
    std::int64_t steps_since = 0;  ///< since the last take_times
    std::int64_t total_us_since = 0;
    std::int64_t max_us_since = 0;
    bool degraded = false;          ///< outcome of the newest step
    std::int64_t last_work_us = 0;  ///< monotonic clock at the newest step that did something; 0: none yet
};

class HostedUnit {
  public:
    /// [setup] Error (kHostFault) if the factory gives no unit.
    static Result<std::unique_ptr<HostedUnit>> create(const teres_factory& factory, UnitServices& services);
    ~HostedUnit();
    HostedUnit(const HostedUnit&) = delete;
    HostedUnit& operator=(const HostedUnit&) = delete;

    Status configure(ResolvedSettings settings);            ///< [setup]
    Status start();                                         ///< [setup]
    teres_step_outcome step(std::int64_t now_us) noexcept;  ///< [loop] IDLE unless running
    void stop() noexcept;                                   ///< [setup]
    /// [setup] Null unless running.
    void* extension(const char* extension_id) noexcept;

    const std::string& id() const { return id_; }
    bool is_driver() const { return factory_.kind == TERES_UNIT_DRIVER; }
    UnitState state() const { return state_; }
    const StepTimes& times() const { return times_; }
    StepTimes take_times() noexcept;

  private:
    HostedUnit(const teres_factory& factory, UnitServices& services);
    Status failed(const std::string& text, ErrorKind kind) noexcept;
    template <class Call>
    Status set_up(const char* what, Call&& call);

    const teres_factory& factory_;
    UnitServices& services_;
    std::string id_;
    teres_host host_{};
    void* self_ = nullptr;
    UnitState state_ = UnitState::kCreated;
    bool started_ = false;  // start succeeded and stop has not been called
    ResolvedSettings settings_;
    StepTimes times_;
};

}  // namespace teres
