// What the drivers ask of libusb, as a table that tests replace. Errors are libusb's (negative).
#pragma once

#include <cstdint>
#include <memory>
#include <span>

namespace teres {

class UsbCalls {
  public:
    virtual ~UsbCalls() = default;
    /// Opens the first device of this vendor and product, takes its first interface from the kernel's driver and finds
    /// its interrupt endpoint. A handle >= 0, or LIBUSB_ERROR_NO_DEVICE, _ACCESS, _BUSY, ...
    virtual int open(std::uint16_t vendor, std::uint16_t product) = 0;
    /// The next interrupt report: its size, LIBUSB_ERROR_TIMEOUT, or another error. No report is lost between calls.
    virtual int read(int handle, std::span<std::uint8_t> to, int timeout_ms) = 0;
    virtual int reset(int handle) = 0;
    virtual void close(int handle) = 0;
    /// Waits for the arrival of a device of this vendor and product; false after the time. Also woken by other events.
    virtual bool arrived(std::uint16_t vendor, std::uint16_t product, int timeout_ms) = 0;
    virtual std::int64_t now_us() = 0;
};

/// The real ones, over a context of their own; null if libusb cannot be set up. One thread at a time.
std::unique_ptr<UsbCalls> make_libusb_calls();

}  // namespace teres
