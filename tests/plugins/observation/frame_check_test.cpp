#include "plugins/observation/frame_check.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "plugins/observation/frame_clock.h"

namespace teres {
namespace {

constexpr int kWidth = 64, kHeight = 48;

StreamInfo info(double depth_unit_m) {
    StreamInfo i;
    i.serial = "A1";
    i.camera = {kWidth, kHeight, 60.0, 60.0, 31.5, 23.5, {}};
    i.depth_unit_m = depth_unit_m;
    return i;
}

image_t frame(const std::string& fourcc, int bytes_per_pixel, std::int64_t stamp_us, std::uint8_t base = 90) {
    image_t m{};
    m.header.capture_stamp_us = stamp_us;
    m.serial = "A1";
    m.fourcc = fourcc;
    m.width_px = kWidth;
    m.height_px = kHeight;
    m.row_stride_bytes = kWidth * bytes_per_pixel;
    m.data.resize(static_cast<std::size_t>(m.row_stride_bytes) * kHeight);
    for (std::size_t i = 0; i < m.data.size(); ++i)
        m.data[i] = static_cast<std::uint8_t>(base + (i * 7 + static_cast<std::size_t>(stamp_us)) % 31);
    m.num_bytes = static_cast<std::int32_t>(m.data.size());
    return m;
}

class BadFrames : public ::testing::Test {
  protected:
    BadFrames() {
        grey.set_info(info(0.0));
        depth.set_info(info(1e-3));
    }
    void expect(FrameCheck& check, image_t m, FrameFault fault) {
        m.header.capture_stamp_us = stamp_us += 1000;
        m.num_bytes = static_cast<std::int32_t>(m.data.size());
        EXPECT_FALSE(check.take(m)) << fault_name(fault);
        EXPECT_EQ(check.count_of(fault), 1) << fault_name(fault);
    }
    FrameCheck grey{FrameCheck::Kind::kGrey}, depth{FrameCheck::Kind::kDepth};
    std::int64_t stamp_us = 1000;
};

TEST_F(BadFrames, AreNamedCountedAndSurvived) {
    expect(grey, frame("Z16 ", 2, 1), FrameFault::kWrongFourcc);
    expect(depth, frame("YUYV", 2, 1), FrameFault::kWrongFourcc);
    auto m = frame("RGB3", 3, 2);
    m.width_px = 2 * kWidth;
    expect(grey, m, FrameFault::kWrongSize);
    m = frame("RGB3", 3, 3);
    m.data.resize(m.data.size() / 2);
    expect(grey, m, FrameFault::kWrongBytes);
    expect(depth, frame("Z16 ", 1, 4), FrameFault::kWrongBytes);
    m = frame("GREY", 1, 5, 0);
    std::fill(m.data.begin(), m.data.end(), std::uint8_t{0});
    expect(grey, m, FrameFault::kBlack);
    std::fill(m.data.begin(), m.data.end(), std::uint8_t{255});
    expect(grey, m, FrameFault::kSaturated);
    m = frame("Z16 ", 2, 6);
    std::fill(m.data.begin(), m.data.end(), std::uint8_t{0});
    expect(depth, m, FrameFault::kBlack);
    m = frame("GREY", 1, 7);
    std::fill(m.data.begin() + std::ssize(m.data) / 2, m.data.end(), std::uint8_t{77});
    expect(grey, m, FrameFault::kHalfFrame);
    m = frame("GREY", 1, 8);
    m.serial = "B2";
    expect(grey, m, FrameFault::kOtherSerial);
    m = frame("MJPG", 1, 9);
    expect(grey, m, FrameFault::kUndecodable);
    m.header.capture_stamp_us = stamp_us += 1000;
    cv::imencode(".jpg", cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(90)), m.data);
    m.data.resize(m.data.size() - 20);
    EXPECT_FALSE(grey.take(m));
    EXPECT_EQ(grey.count_of(FrameFault::kHalfFrame), 2);
}

TEST_F(BadFrames, WithExchangedBytes) {
    auto m = frame("Z16 ", 2, 1);
    for (std::size_t i = 0; i < m.data.size() / 2; ++i) {
        const auto counts = static_cast<std::uint16_t>(2900 + 3 * (i % kWidth) + i % 5);  // a slope, D400 noise
        m.data[2 * i] = static_cast<std::uint8_t>(counts & 0xff);
        m.data[2 * i + 1] = static_cast<std::uint8_t>(counts >> 8);
    }
    EXPECT_TRUE(depth.take(m));
    for (std::size_t i = 0; i < m.data.size(); i += 2) std::swap(m.data[i], m.data[i + 1]);
    expect(depth, m, FrameFault::kByteOrder);
}

TEST_F(BadFrames, WithoutUnitOrCalibration) {
    depth.set_info(info(0.0));
    expect(depth, frame("Z16 ", 2, 1), FrameFault::kNoDepthUnit);
    FrameCheck unknown(FrameCheck::Kind::kGrey);
    expect(unknown, frame("GREY", 1, 2), FrameFault::kNoCalibration);
}

TEST_F(BadFrames, RepeatedLateAndFrozen) {
    EXPECT_TRUE(grey.take(frame("GREY", 1, 5000)));
    EXPECT_FALSE(grey.take(frame("GREY", 1, 5000)));
    EXPECT_EQ(grey.count_of(FrameFault::kRepeated), 1);
    EXPECT_FALSE(grey.take(frame("GREY", 1, 4000)));
    EXPECT_EQ(grey.count_of(FrameFault::kLate), 1);
    auto m = frame("GREY", 1, 5000);
    m.header.capture_stamp_us = 6000;
    EXPECT_FALSE(grey.take(m));
    EXPECT_EQ(grey.count_of(FrameFault::kFrozen), 1);
    EXPECT_TRUE(grey.take(frame("GREY", 1, 7001)));
}

TEST_F(BadFrames, GoodOnesOfEveryKindAreTaken) {
    std::int64_t t = 10;
    for (const auto& [fourcc, bytes] : {std::pair{"RGB3", 3}, {"BGR3", 3}, {"YUYV", 2}, {"GREY", 1}}) {
        const auto image = grey.take(frame(fourcc, bytes, t++));
        ASSERT_TRUE(image) << fourcc;
        EXPECT_EQ(image->type(), CV_8U);
        EXPECT_EQ(image->size(), cv::Size(kWidth, kHeight));
    }
    ASSERT_TRUE(depth.take(frame("Z16 ", 2, t)));
}

// Reception = 1.00005 capture + 3 s + delays of at least 20 ms.
TEST(FrameClock, FindsOffsetAndDrift) {
    FrameClock clock;
    for (int k = 0; k < 3000; ++k) {
        const std::int64_t capture_us = 1'000'000 + 33'333LL * k;
        const double delay = 0.020 + (k % 7 == 0 ? 0.0 : 0.001 * (k % 5));
        clock.add(capture_us,
                  std::llround(1.00005 * static_cast<double>(capture_us)) + 3'000'000 + std::llround(1e6 * delay));
    }
    EXPECT_NEAR(clock.drift_ppm(), 50.0, 5.0);
    EXPECT_NEAR(clock.offset_s(), 3.020 + 50e-6 * 101.0, 1e-3);
    EXPECT_LT(clock.latency_s(), 0.006);
}

}  // namespace
}  // namespace teres
