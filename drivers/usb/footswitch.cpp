#include "drivers/usb/footswitch.h"

#include <libusb-1.0/libusb.h>

#include <array>
#include <charconv>
#include <cstdio>

namespace teres {

std::optional<std::uint8_t> parse_pedals(std::span<const std::uint8_t> report) {
    constexpr std::uint8_t kAll = (1 << kNumPedals) - 1;
    if (report.size() != 2 || (report[0] & ~kAll) != 0 || report[1] != 0) return std::nullopt;
    return report[0];
}

Result<UsbId> parse_usb_id(const std::string& text) {
    UsbId id;
    const char* begin = text.data();
    const char* end = begin + text.size();
    const auto vendor = std::from_chars(begin, end, id.vendor, 16);
    if (vendor.ec == std::errc{} && vendor.ptr != end && *vendor.ptr == ':') {
        const auto product = std::from_chars(vendor.ptr + 1, end, id.product, 16);
        if (product.ec == std::errc{} && product.ptr == end) return id;
    }
    return invalid_input("'" + text + "' is not vendor:product in hexadecimal, as 05f3:00ff");
}

Footswitch::Footswitch(std::unique_ptr<UsbCalls> calls, UsbId id, const DeviceWatch::Limits& limits)
    : calls_(std::move(calls)), id_(id), watch_(limits) {}

Footswitch::~Footswitch() {
    close();
}

void Footswitch::pass() {
    const std::int64_t now_us = calls_->now_us();
    if (watch_.state() == DeviceState::kAbsent) {
        const bool arrived = calls_->arrived(id_.vendor, id_.product, kWaitMs);
        // Looking at the list as well finds what arrived unseen.
        if (arrived || now_us >= next_look_us_) open(calls_->now_us());
    } else if (const RecoveryStep step = watch_.due(now_us); step != RecoveryStep::kNone) {
        recover(step, now_us);
    } else if (handle_ < 0) {
        calls_->arrived(id_.vendor, id_.product, kWaitMs);
    } else {
        std::array<std::uint8_t, 64> report{};
        const int size = calls_->read(handle_, report, kWaitMs);
        if (size >= 0) {
            const auto down = parse_pedals(std::span(report).first(static_cast<std::size_t>(size)));
            const std::int64_t at_us = calls_->now_us();
            if (down) {
                ++received_;
                newest_us_ = at_us;
                watch_.data(at_us);
                fault_.clear();
                advice_.clear();
                set_pedals(*down, at_us);
            } else {
                ++damaged_;
                watch_.damaged(at_us);
                if (watch_.state() != DeviceState::kStreaming) fault_ = "reports that are not of a footswitch";
            }
        } else if (size == LIBUSB_ERROR_TIMEOUT || size == LIBUSB_ERROR_INTERRUPTED) {
            watch_.data(now_us);  // it is silent as long as nobody steps on it
            fault_.clear();
            advice_.clear();
        } else {
            failed("read", size, now_us);
        }
    }
    share();
}

void Footswitch::open(std::int64_t now_us) {
    constexpr std::int64_t kLookEveryUs = 500'000;
    next_look_us_ = now_us + kLookEveryUs;
    close();
    const int handle = calls_->open(id_.vendor, id_.product);
    if (handle < 0) {
        failed("open", handle, now_us);
        return;
    }
    handle_ = handle;
    watch_.found(now_us);
}

void Footswitch::close() {
    if (handle_ >= 0) calls_->close(handle_);
    handle_ = -1;
    set_pedals(0, calls_->now_us());  // what is not there is not held down
}

void Footswitch::recover(RecoveryStep step, std::int64_t now_us) {
    if (step == RecoveryStep::kReset && handle_ >= 0) {
        calls_->reset(handle_);
        close();
        watch_.gone();  // until it is back
    } else if (step == RecoveryStep::kAdvisePowerCycle) {
        advice_ = "; no answer in spite of a reset: unplug it and plug it in again";
    } else {
        open(now_us);
    }
}

void Footswitch::failed(const char* what, int error, std::int64_t now_us) {
    if (error == LIBUSB_ERROR_NO_DEVICE || error == LIBUSB_ERROR_NOT_FOUND) {
        close();
        watch_.gone();
        char text[64];
        std::snprintf(text, sizeof text, "footswitch %04x:%04x is not connected", id_.vendor, id_.product);
        fault_ = text;
        return;
    }
    fault_ = std::string(what) + ": " + libusb_strerror(error) +
             (error == LIBUSB_ERROR_ACCESS ? "; install the udev rule of Teres, or the group plugdev" : "");
    const bool refused =
        error == LIBUSB_ERROR_ACCESS || error == LIBUSB_ERROR_BUSY || error == LIBUSB_ERROR_NOT_SUPPORTED;
    if (refused) {
        close();
        watch_.refused(now_us);
    } else {
        watch_.found(now_us);
        watch_.error(now_us);
        calls_->arrived(id_.vendor, id_.product, 5);  // a call that fails at once must not keep the processor busy
    }
}

void Footswitch::set_pedals(std::uint8_t down, std::int64_t now_us) {
    const std::lock_guard lock(mutex_);
    for (int pedal = 0; pedal < kNumPedals; ++pedal) {
        const int bit = 1 << pedal;
        if (((down ^ down_) & bit) == 0) continue;
        if (waiting_.size() == kMaxWaiting) {
            waiting_.pop_front();
            ++lost_;
        }
        waiting_.push_back({now_us, pedal, (down & bit) != 0});
    }
    down_ = down;
}

void Footswitch::share() {
    const std::lock_guard lock(mutex_);
    char id[16];
    std::snprintf(id, sizeof id, "%04x:%04x", id_.vendor, id_.product);
    shared_.state = watch_.state();
    shared_.serial = id;
    shared_.detail = fault_ + advice_;
    shared_.last_us = newest_us_;
    shared_.received = received_;
    shared_.damaged = damaged_;
    shared_.lost = lost_;
    shared_.recoveries = watch_.recoveries();
}

bool Footswitch::take(PedalEvent& to) {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) return false;
    to = waiting_.front();
    waiting_.pop_front();
    return true;
}

DeviceReport Footswitch::report() {
    const std::lock_guard lock(mutex_);
    return shared_;
}

}  // namespace teres
