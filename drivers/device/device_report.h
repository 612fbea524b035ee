// What DEVICE_HEALTH says of one device, and when: at every change of state and once a second.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "core/plugin_sdk.h"
#include "drivers/device/device_watch.h"
#include "teres/device_health_t.hpp"

namespace teres {

struct DeviceReport {
    DeviceState state = DeviceState::kAbsent;
    std::string serial, node;
    std::string detail;        ///< newest fault or advice in words
    std::int64_t last_us = 0;  ///< newest data; 0: none yet
    std::int64_t received = 0, lost = 0, damaged = 0, recoveries = 0;
    int usb_mbps = 0;  ///< 0: unknown
    double temperature_c = std::numeric_limits<double>::quiet_NaN();
};

class DeviceReporter {
  public:
    explicit DeviceReporter(std::string device) : device_(std::move(device)) {}
    /// [loop] Publishes if due; logs every change of state or of the fault.
    void tell(Host& host, const DeviceReport& report, std::int64_t now_us);

  private:
    static constexpr std::int64_t kPeriodUs = 1'000'000;

    std::string device_;
    std::int64_t next_us_ = 0, rate_from_us_ = 0, rate_from_count_ = 0;
    std::string said_;
    device_health_t message_{};
};

}  // namespace teres
