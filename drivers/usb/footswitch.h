// A footswitch with three pedals (VEC Infinity, USB 05f3:00ff): HID reports of two bytes, little-endian bit mask of the
// pedals that are down: 1 left, 2 middle, 4 right. pass() runs on a thread of its own.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "core/result.h"
#include "drivers/device/device_report.h"
#include "drivers/device/device_watch.h"
#include "drivers/usb/usb_calls.h"

namespace teres {

inline constexpr int kNumPedals = 3;

/// Mask of the pedals that are down. Empty: not a report of this device.
std::optional<std::uint8_t> parse_pedals(std::span<const std::uint8_t> report);

struct UsbId {
    std::uint16_t vendor = 0, product = 0;
};
/// "05f3:00ff". Error: not of this form.
Result<UsbId> parse_usb_id(const std::string& text);

struct PedalEvent {
    std::int64_t at_us = 0;
    int pedal = 0;  ///< 0 left, 1 middle, 2 right
    bool down = false;
};

class Footswitch {
  public:
    Footswitch(std::unique_ptr<UsbCalls> calls, UsbId id, const DeviceWatch::Limits& limits);
    ~Footswitch();

    /// [device thread] Waits at most kWaitMs for a report or for the device.
    void pass();
    static constexpr int kWaitMs = 50;

    /// [loop] The oldest event, each once.
    bool take(PedalEvent& to);
    DeviceReport report();  ///< [loop]

  private:
    void open(std::int64_t now_us);
    void close();
    void recover(RecoveryStep step, std::int64_t now_us);
    void failed(const char* what, int error, std::int64_t now_us);
    void set_pedals(std::uint8_t down, std::int64_t now_us);
    void share();

    std::unique_ptr<UsbCalls> calls_;
    const UsbId id_;
    DeviceWatch watch_;
    int handle_ = -1;
    std::uint8_t down_ = 0;
    std::int64_t received_ = 0, damaged_ = 0, newest_us_ = 0, next_look_us_ = 0;
    std::string fault_, advice_;  // empty while all is well

    static constexpr std::size_t kMaxWaiting = 64;
    std::mutex mutex_;
    std::deque<PedalEvent> waiting_;
    std::int64_t lost_ = 0;
    DeviceReport shared_;
};

}  // namespace teres
