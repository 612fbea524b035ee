// Units working together over one bus: what `teres run`, the offline commands and the tests all host plugins
// with.
//
//     auto session = Session::open(config);      // plugins loaded and probed, bus open, units configured
//     session->subscribe<boundary_estimate_t>("BOUNDARY_ESTIMATE", 1 << 24, [&](const auto& message) { ... });
//     session->start();                          // plugins in the order of the settings file, then drivers
//     session->run_until_finished();             // every frame worked through before the next is asked for
//     auto* model = session->extension<ForwardModel>();
//
// One turn: drivers step, then (bus dispatch, plugins step) until nobody has anything left to do. With
// memq:// and a driver that does not wait (speed 0) nothing is lost and every run takes the same steps in the
// same order.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/bus.h"
#include "core/config.h"
#include "core/extensions/stream_clock.h"
#include "core/health.h"
#include "core/hosted_unit.h"
#include "core/plugin_host.h"
#include "core/recorder.h"
#include "core/result.h"

namespace teres {

struct Turn {
    bool worked = false;    ///< a unit did something or a message was delivered
    bool finished = false;  ///< every driver's stream has ended and all of it is worked through
};

class Session final : private UnitServices {
  public:
    /// [setup] Errors: unknown section or setting, a plugin that cannot be loaded, a bus that cannot be
    /// opened, a unit that refuses its settings. Nothing is left behind on failure.
    static Result<std::unique_ptr<Session>> open(const Config& config);
    /// [setup] Only the first part of open: loads every plugin in use and checks every section.
    static Status check(const Config& config);
    ~Session();
    Session(const Session&) = delete;
    Session& operator=(const Session&) = delete;

    /// [setup] Between open and start, for the owner's own reading. Malformed messages are dropped.
    Status subscribe(const std::string& channel, std::size_t max_bytes, Bus::Handler handler);
    template <class Message>
    Status subscribe(const std::string& channel, std::size_t max_bytes, std::function<void(const Message&)> handler);

    /// [setup] On failure the units that did start are stopped.
    Status start();
    /// [loop] One turn; when there is nothing to do it waits at most service.idle_wait_ms for a message.
    Turn step() noexcept;
    /// [setup] Turns until finished, or until `keep_going` (asked after every turn) says no. Errors: no
    /// drivers, or a unit failed on the way (kHostFault).
    Status run_until_finished(const std::function<bool()>& keep_going = {});
    /// [setup] Stops the units, drivers first, and closes the recording. Also done by the destructor.
    void stop() noexcept;

    /// [setup] Interface T (with T::kId) of a running unit, or null. Valid while the session lives.
    template <class T>
    T* extension() {
        return static_cast<T*>(find_extension(T::kId));
    }

    /// [loop] Composes HEALTH and publishes it; false if the bus refused.
    bool publish_health() noexcept;
    const health_t& health() const { return health_; }  ///< as last published
    const std::vector<std::unique_ptr<HostedUnit>>& plugins() const { return plugins_; }
    const std::vector<std::unique_ptr<HostedUnit>>& drivers() const { return drivers_; }
    const ServiceSettings& settings() const { return settings_; }
    /// [loop] The provider gave up (not the end of a file:// log).
    bool bus_failed() const noexcept { return bus_ended_ && !settings_.bus_url.starts_with("file://"); }
    /// [loop] Empty, or the unit that failed while running.
    std::string failed_unit() const;

  private:
    struct Subscription {
        Session* session;
        HostedUnit* unit;
        teres_message_handler handler;
        void* user;
        bool counts;  // the first of its pattern keeps the traffic book
        bool active;
    };

    explicit Session(const ServiceSettings& settings) : settings_(settings) {}
    Status open_recorder();
    void* find_extension(const char* extension_id) noexcept;
    int drain() noexcept;
    bool step_plugins() noexcept;
    void silence(const HostedUnit& unit) noexcept;

    bool publish(HostedUnit& unit, const char* channel, const void* data, std::size_t size) noexcept override;
    bool subscribe(HostedUnit& unit, const char* channel, std::size_t max_bytes, teres_message_handler handler,
                   void* user) noexcept override;
    void* extension_for(HostedUnit& unit, const char* extension_id) noexcept override;
    std::int64_t now_us() const noexcept override;

    ServiceSettings settings_;
    // Units come after what they use: they are destroyed first.
    std::optional<Bus> bus_;
    std::optional<Recorder> recorder_;
    std::deque<Subscription> subscriptions_;
    std::vector<std::string> counted_patterns_;
    TrafficBook traffic_;
    MemoryReader memory_;
    std::vector<std::unique_ptr<HostedUnit>> plugins_, drivers_;
    StreamClock* clock_ = nullptr;
    bool bus_ended_ = false;

    std::int64_t opened_us_ = 0;
    std::int64_t iterations_ = 0;
    std::int64_t longest_turn_us_ = 0;
    health_t health_{};
    std::vector<std::uint8_t> health_bytes_;
};

template <class Message>
Status Session::subscribe(const std::string& channel, std::size_t max_bytes,
                          std::function<void(const Message&)> handler) {
    auto message = std::make_shared<Message>();
    return subscribe(
        channel, max_bytes,
        [message, handler = std::move(handler)](std::string_view, std::span<const std::uint8_t> data, std::int64_t) {
            if (message->decode(data.data(), 0, static_cast<int>(data.size())) >= 0) handler(*message);
        });
}

}  // namespace teres
