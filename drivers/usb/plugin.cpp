// Unit `pedal` (driver): footswitch; says which pedal went down or up and what that means.
#include <chrono>
#include <limits>
#include <memory>
#include <optional>

#include "core/clock.h"
#include "core/plugin_sdk.h"
#include "drivers/device/device_report.h"
#include "drivers/device/device_thread.h"
#include "drivers/usb/footswitch.h"
#include "teres/pedal_t.hpp"

namespace teres {

struct PedalSettings {
    std::string device = "05f3:00ff";
    std::string left = "record", middle = "mark", right = "none";
    template <class V>
    void visit(V& field) {
        constexpr const char* kActions = "record|mark|none";
        field("device", device, "", "vendor:product of the footswitch; default: VEC Infinity");
        field("left", left, kActions, "what the left pedal does: start and stop recording, mark an event");
        field("middle", middle, kActions, "what the middle pedal does");
        field("right", right, kActions, "what the right pedal does");
    }
};

class PedalDriver final : public Unit {
  public:
    using Settings = PedalSettings;
    Settings settings;

    explicit PedalDriver(Host host) : host_(std::move(host)), reporter_("pedal") {}

    Status configure() override {
        const auto id = parse_usb_id(settings.device);
        if (!id) return invalid_input("pedal.device: " + id.error().text);
        id_ = *id;
        return {};
    }

    Status start() override {
        auto calls = make_libusb_calls();
        if (!calls) return host_fault("pedal: libusb cannot be set up");
        DeviceWatch::Limits limits;
        limits.stale_after_us = std::numeric_limits<std::int64_t>::max() / 4;  // silence is no fault
        footswitch_ = std::make_shared<Footswitch>(std::move(calls), id_, limits);
        thread_.emplace(footswitch_);
        return {};
    }

    teres_step_outcome step(std::int64_t) noexcept override try {
        const std::int64_t now_us = monotonic_us();
        if (now_us >= next_report_us_) {
            next_report_us_ = now_us + kReportEveryUs;
            reporter_.tell(host_, footswitch_->report(), now_us);
        }
        bool worked = false;
        for (PedalEvent event; footswitch_->take(event); worked = true) publish(event);
        return worked ? TERES_STEP_DONE : TERES_STEP_IDLE;
    } catch (...) {  // out of memory
        return TERES_STEP_DEGRADED;
    }

    void stop() override {
        if (thread_ && !thread_->stop(std::chrono::seconds(2)))
            host_.log(TERES_LOG_WARN, "pedal", "the kernel does not give the device back");
        thread_.reset();
        footswitch_.reset();
    }

  private:
    static constexpr std::int64_t kReportEveryUs = 20'000;

    void publish(const PedalEvent& event) {
        static constexpr const char* kNames[kNumPedals] = {"left", "middle", "right"};
        const std::string* actions[kNumPedals] = {&settings.left, &settings.middle, &settings.right};
        message_.header.capture_stamp_us = event.at_us;
        message_.header.sequence = sequence_++;
        message_.device = settings.device;
        message_.pedal = kNames[event.pedal];
        message_.down = event.down ? 1 : 0;
        message_.action = *actions[event.pedal];
        host_.publish("PEDAL", message_);
    }

    Host host_;
    DeviceReporter reporter_;
    UsbId id_;
    std::shared_ptr<Footswitch> footswitch_;
    std::optional<DeviceThread> thread_;
    pedal_t message_{};
    std::int64_t sequence_ = 0, next_report_us_ = 0;
};

}  // namespace teres

TERES_PLUGIN(teres::PedalDriver, "pedal", "footswitch: start and stop recording, mark an event", TERES_UNIT_DRIVER)
