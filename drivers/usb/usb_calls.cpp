#include "drivers/usb/usb_calls.h"

#include <libusb-1.0/libusb.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "core/clock.h"

namespace teres {
namespace {

constexpr int kReportBytes = 64;  // largest full-speed interrupt packet

class LibusbCalls final : public UsbCalls {
  public:
    explicit LibusbCalls(libusb_context* context) : context_(context) {}
    ~LibusbCalls() override {
        close(0);
        libusb_exit(context_);
    }

    int open(std::uint16_t vendor, std::uint16_t product) override {
        close(0);
        libusb_device** list = nullptr;
        const ssize_t count = libusb_get_device_list(context_, &list);
        int result = count < 0 ? static_cast<int>(count) : LIBUSB_ERROR_NO_DEVICE;
        for (ssize_t i = 0; i < count && handle_ == nullptr; ++i) {
            libusb_device_descriptor descriptor{};
            if (libusb_get_device_descriptor(list[i], &descriptor) != 0 || descriptor.idVendor != vendor ||
                descriptor.idProduct != product)
                continue;
            result = open_device(list[i]);
        }
        if (list != nullptr) libusb_free_device_list(list, 1);
        return result;
    }

    int read(int, std::span<std::uint8_t> to, int timeout_ms) override {
        if (handle_ == nullptr) return LIBUSB_ERROR_NO_DEVICE;
        if (!pending_) {
            libusb_fill_interrupt_transfer(
                transfer_, handle_, endpoint_, report_.data(), kReportBytes,
                [](libusb_transfer* transfer) { static_cast<LibusbCalls*>(transfer->user_data)->done_ = 1; }, this, 0);
            done_ = 0;
            if (const int failed = libusb_submit_transfer(transfer_); failed != 0) return failed;
            pending_ = true;
        }
        if (const int failed = handle_events(timeout_ms, &done_); failed != 0) return failed;
        if (done_ == 0) return LIBUSB_ERROR_TIMEOUT;
        pending_ = false;
        switch (transfer_->status) {
            case LIBUSB_TRANSFER_COMPLETED:
                break;
            case LIBUSB_TRANSFER_NO_DEVICE:
                return LIBUSB_ERROR_NO_DEVICE;
            case LIBUSB_TRANSFER_STALL:
                libusb_clear_halt(handle_, endpoint_);
                return LIBUSB_ERROR_PIPE;
            case LIBUSB_TRANSFER_OVERFLOW:
                return LIBUSB_ERROR_OVERFLOW;
            default:
                return LIBUSB_ERROR_IO;
        }
        const auto size = std::min(to.size(), static_cast<std::size_t>(std::max(transfer_->actual_length, 0)));
        std::memcpy(to.data(), report_.data(), size);
        return static_cast<int>(size);
    }

    int reset(int) override { return handle_ != nullptr ? libusb_reset_device(handle_) : LIBUSB_ERROR_NO_DEVICE; }

    void close(int) override {
        if (handle_ == nullptr) return;
        if (pending_) {
            libusb_cancel_transfer(transfer_);
            for (int i = 0; i < 20 && done_ == 0; ++i) handle_events(50, &done_);
        }
        // A transfer that the kernel never gives back must not be freed.
        if (!pending_ || done_ != 0) libusb_free_transfer(transfer_);
        pending_ = false;
        transfer_ = nullptr;
        libusb_release_interface(handle_, 0);
        libusb_close(handle_);
        handle_ = nullptr;
    }

    bool arrived(std::uint16_t vendor, std::uint16_t product, int timeout_ms) override {
        if (!listening_ && libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0) {
            listening_ = libusb_hotplug_register_callback(
                             context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, LIBUSB_HOTPLUG_NO_FLAGS, vendor, product,
                             LIBUSB_HOTPLUG_MATCH_ANY,
                             [](libusb_context*, libusb_device*, libusb_hotplug_event, void* self) {
                                 static_cast<LibusbCalls*>(self)->arrived_ = 1;
                                 return 0;
                             },
                             this, nullptr) == 0;
        }
        arrived_ = 0;
        handle_events(timeout_ms, &arrived_);
        return arrived_ != 0;
    }

    std::int64_t now_us() override { return monotonic_us(); }

  private:
    int handle_events(int timeout_ms, int* until) {
        timeval time{timeout_ms / 1000, timeout_ms % 1000 * 1000};
        return libusb_handle_events_timeout_completed(context_, &time, until);
    }

    int open_device(libusb_device* device) {
        libusb_config_descriptor* config = nullptr;
        if (const int failed = libusb_get_active_config_descriptor(device, &config); failed != 0) return failed;
        endpoint_ = 0;
        if (config->bNumInterfaces > 0 && config->interface[0].num_altsetting > 0) {
            const libusb_interface_descriptor& first = config->interface[0].altsetting[0];
            for (int i = 0; i < first.bNumEndpoints; ++i) {
                const libusb_endpoint_descriptor& endpoint = first.endpoint[i];
                if ((endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0 &&
                    (endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) == LIBUSB_TRANSFER_TYPE_INTERRUPT)
                    endpoint_ = endpoint.bEndpointAddress;
            }
        }
        libusb_free_config_descriptor(config);
        if (endpoint_ == 0) return LIBUSB_ERROR_NOT_SUPPORTED;
        if (const int failed = libusb_open(device, &handle_); failed != 0) {
            handle_ = nullptr;
            return failed;
        }
        libusb_set_auto_detach_kernel_driver(handle_, 1);
        int failed = libusb_claim_interface(handle_, 0);
        if (failed == 0 && (transfer_ = libusb_alloc_transfer(0)) == nullptr) failed = LIBUSB_ERROR_NO_MEM;
        if (failed == 0) return 0;
        libusb_close(handle_);
        handle_ = nullptr;
        return failed;
    }

    libusb_context* context_;
    libusb_device_handle* handle_ = nullptr;
    libusb_transfer* transfer_ = nullptr;
    unsigned char endpoint_ = 0;
    std::array<unsigned char, kReportBytes> report_{};
    bool pending_ = false, listening_ = false;
    int done_ = 0, arrived_ = 0;
};

}  // namespace

std::unique_ptr<UsbCalls> make_libusb_calls() {
    libusb_context* context = nullptr;
    if (libusb_init(&context) != 0) return nullptr;
    return std::make_unique<LibusbCalls>(context);
}

}  // namespace teres
