// The footswitch over a made-up USB: reports, faults, unplugging.
#include "drivers/usb/footswitch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <libusb-1.0/libusb.h>

#include <deque>
#include <limits>
#include <vector>

namespace teres {
namespace {

using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

struct FakeUsb final : UsbCalls {
    bool plugged = true;
    int open_error = 0;
    std::deque<int> read_errors;
    std::deque<Bytes> reports;
    int resets = 0, opens = 0, open_handles = 0;
    bool reset_helps = false, broken = false;
    std::int64_t clock_us = 1'000'000;

    int open(std::uint16_t, std::uint16_t) override {
        ++opens;
        if (!plugged) return LIBUSB_ERROR_NO_DEVICE;
        if (open_error != 0) return open_error;
        ++open_handles;
        return 0;
    }
    int read(int, std::span<std::uint8_t> to, int timeout_ms) override {
        if (!plugged) return LIBUSB_ERROR_NO_DEVICE;
        clock_us += 1000;
        if (broken) return LIBUSB_ERROR_IO;
        if (!read_errors.empty()) {
            const int error = read_errors.front();
            read_errors.pop_front();
            return error;
        }
        if (reports.empty()) {
            clock_us += 1000 * timeout_ms;
            return LIBUSB_ERROR_TIMEOUT;
        }
        const Bytes report = reports.front();
        reports.pop_front();
        std::copy(report.begin(), report.end(), to.begin());
        return static_cast<int>(report.size());
    }
    int reset(int) override {
        ++resets;
        if (reset_helps) broken = false;
        return 0;
    }
    void close(int) override { --open_handles; }
    bool arrived(std::uint16_t, std::uint16_t, int timeout_ms) override {
        clock_us += 1000 * timeout_ms;
        return false;
    }
    std::int64_t now_us() override { return clock_us; }
};

class FootswitchTest : public testing::Test {
  protected:
    FootswitchTest() {
        auto calls = std::make_unique<FakeUsb>();
        usb_ = calls.get();
        footswitch_ = std::make_unique<Footswitch>(std::move(calls), UsbId{0x05f3, 0x00ff},
                                                   DeviceWatch::Limits{std::numeric_limits<std::int64_t>::max() / 4});
    }
    /// "L+" left down, "R-" right up, ...
    std::string run(double seconds) {
        const std::int64_t end = usb_->clock_us + static_cast<std::int64_t>(1e6 * seconds);
        while (usb_->clock_us < end) footswitch_->pass();
        std::string text;
        for (PedalEvent event; footswitch_->take(event);)
            text += std::string(1, "LMR"[event.pedal]) + (event.down ? "+" : "-");
        return text;
    }
    FakeUsb* usb_;
    std::unique_ptr<Footswitch> footswitch_;
};

TEST_F(FootswitchTest, EveryChangeOfEveryPedalIsOneEvent) {
    usb_->reports = {{1, 0}, {1, 0}, {0, 0}, {6, 0}, {2, 0}, {0, 0}};
    EXPECT_EQ(run(1.0), "L+L-M+R+R-M-");
    EXPECT_EQ(footswitch_->report().state, DeviceState::kStreaming);
    EXPECT_EQ(run(3600.0), "") << "silence is no fault";
    EXPECT_EQ(footswitch_->report().state, DeviceState::kStreaming);
}

TEST_F(FootswitchTest, ReportsThatAreNoneAreCountedNotObeyed) {
    usb_->reports = {{}, {1}, {1, 0, 0}, {8, 0}, {1, 0}};
    EXPECT_EQ(run(1.0), "L+");
    EXPECT_EQ(footswitch_->report().damaged, 4);
}

TEST_F(FootswitchTest, UnpluggedWhileHeldDownIsReleasedAndFoundAgain) {
    usb_->reports = {{4, 0}};
    EXPECT_EQ(run(0.5), "R+");
    usb_->plugged = false;
    EXPECT_EQ(run(2.0), "R-");
    EXPECT_EQ(footswitch_->report().state, DeviceState::kAbsent);
    EXPECT_THAT(footswitch_->report().detail, HasSubstr("05f3:00ff is not connected"));
    usb_->plugged = true;
    usb_->reports = {{1, 0}};
    EXPECT_EQ(run(1.0), "L+");
    EXPECT_EQ(footswitch_->report().detail, "");
    EXPECT_EQ(usb_->open_handles, 1);
}

TEST_F(FootswitchTest, SingleTransferErrorLosesNothing) {
    usb_->read_errors = {LIBUSB_ERROR_PIPE};
    usb_->reports = {{1, 0}};
    EXPECT_EQ(run(2.0), "L+");
    EXPECT_EQ(usb_->resets, 0);
}

TEST_F(FootswitchTest, DeadOneIsReopenedThenResetThenAdvised) {
    run(0.2);
    usb_->broken = true;
    run(1.5);
    EXPECT_GE(usb_->opens, 2);
    EXPECT_EQ(usb_->resets, 0);
    run(1.5);
    EXPECT_EQ(usb_->resets, 1);
    run(4.0);
    EXPECT_THAT(footswitch_->report().detail, HasSubstr("unplug it"));
    usb_->reset_helps = true;
    run(8.0);
    EXPECT_GE(usb_->resets, 2);
    EXPECT_EQ(footswitch_->report().state, DeviceState::kStreaming);
    EXPECT_EQ(footswitch_->report().detail, "");
}

TEST_F(FootswitchTest, WithoutPermissionTheRemedyIsSaid) {
    usb_->open_error = LIBUSB_ERROR_ACCESS;
    run(5.0);
    EXPECT_EQ(footswitch_->report().state, DeviceState::kRecovering);
    EXPECT_THAT(footswitch_->report().detail, HasSubstr("udev rule"));
    EXPECT_EQ(usb_->resets, 0);
    usb_->open_error = 0;
    usb_->reports = {{1, 0}};
    EXPECT_EQ(run(2.0), "L+");
}

TEST(UsbId, IsTwoHexadecimalNumbers) {
    EXPECT_EQ(parse_usb_id("05f3:00ff")->product, 0xff);
    for (const char* bad : {"", "05f3", "05f3:", ":00ff", "05f3:100ff", "x:1", "1:2 "})
        EXPECT_FALSE(parse_usb_id(bad)) << bad;
}

}  // namespace
}  // namespace teres
