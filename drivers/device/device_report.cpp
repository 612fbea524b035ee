#include "drivers/device/device_report.h"

namespace teres {

void DeviceReporter::tell(Host& host, const DeviceReport& report, std::int64_t now_us) {
    const std::string says = std::string(state_word(report.state)) +
                             (report.serial.empty() ? "" : ", serial " + report.serial) +
                             (report.detail.empty() ? "" : ": " + report.detail);
    const bool changed = says != said_;
    if (changed) {
        const bool good = report.state == DeviceState::kStreaming && report.detail.empty();
        host.log(good ? TERES_LOG_INFO : TERES_LOG_WARN, device_, says);
        said_ = says;
    }
    if (!changed && now_us < next_us_) return;
    const double period_s = 1e-6 * static_cast<double>(now_us - rate_from_us_);
    if (rate_from_us_ > 0 && period_s > 0.5)
        message_.rate_hz = static_cast<double>(report.received - rate_from_count_) / period_s;
    if (rate_from_us_ == 0 || period_s > 0.5) {
        rate_from_us_ = now_us;
        rate_from_count_ = report.received;
    }
    next_us_ = now_us + kPeriodUs;
    message_.header.capture_stamp_us = now_us;
    ++message_.header.sequence;
    message_.device = device_;
    message_.serial = report.serial;
    message_.node = report.node;
    message_.state = state_word(report.state);
    message_.detail = report.detail;
    message_.age_s = report.last_us > 0 ? 1e-6 * static_cast<double>(now_us - report.last_us) : -1.0;
    message_.received = report.received;
    message_.lost = report.lost;
    message_.damaged = report.damaged;
    message_.recoveries = report.recoveries;
    message_.usb_mbps = report.usb_mbps;
    message_.temperature_c = report.temperature_c;
    host.publish("DEVICE_HEALTH", message_);
}

}  // namespace teres
