// What a D4xx answers over its extension unit: the layout by hand, and everything that can be wrong with it.
#include "drivers/camera/realsense.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/drivers/camera/fake_camera.h"

namespace teres {
namespace {

using realsense::Bytes;
using testing::HasSubstr;

TEST(RealSense, CrcIsTheOneOfIeee8023) {
    const std::string check = "123456789";  // the standard check value
    EXPECT_EQ(realsense::crc32({reinterpret_cast<const std::uint8_t*>(check.data()), check.size()}), 0xcbf43926u);
}

TEST(RealSense, CommandHasItsLayout) {
    const Bytes packet = realsense::command_packet(0x15, {25});
    ASSERT_EQ(packet.size(), 1024u);
    const Bytes head(packet.begin(), packet.begin() + 12);
    EXPECT_EQ(head, (Bytes{20, 0, 0xab, 0xcd, 0x15, 0, 0, 0, 25, 0, 0, 0}));
}

TEST(RealSense, AnswerMustEchoTheCommandAndFit) {
    Bytes packet(1024);
    packet[0] = 0x10;
    packet[1020] = 8;
    EXPECT_EQ(realsense::answer_data(0x10, packet)->size(), 8u);
    packet[1020] = 0;
    EXPECT_EQ(realsense::answer_data(0x10, packet)->size(), 1016u) << "old firmware tells no length";
    packet[1021] = 4;
    EXPECT_THAT(realsense::answer_data(0x10, packet).error().text, HasSubstr("announces 1024 bytes, above 1016"));
    EXPECT_THAT(realsense::answer_data(0x15, packet).error().text, HasSubstr("answer to command 16"));
    std::memset(packet.data(), 0xff, 4);
    EXPECT_THAT(realsense::answer_data(0x15, packet).error().text, HasSubstr("refused by the firmware, error -1"));
    EXPECT_FALSE(realsense::answer_data(0x10, std::span(packet).first(1023)));
}

TEST(RealSense, IdentityIsReadFromItsPlaces) {
    const auto identity = realsense::parse_identity(test::identity_block());
    ASSERT_TRUE(identity);
    EXPECT_EQ(identity->firmware, "5.16.0.1");
    EXPECT_EQ(identity->serial, "842512070299");
    EXPECT_EQ(identity->asic_serial, "123456789abc");
    EXPECT_FALSE(realsense::parse_identity(Bytes(69)));
}

TEST(RealSense, DepthTableGivesTheCameraOfTheSize) {
    const auto model = realsense::parse_depth_table(test::depth_table(), 640, 480);
    ASSERT_TRUE(model) << model.error().text;
    EXPECT_FLOAT_EQ(static_cast<float>(model->fy_px), 386.7f);
    EXPECT_FLOAT_EQ(static_cast<float>(model->cx_px), 321.2f);
    EXPECT_NEAR(*realsense::parse_baseline_m(test::depth_table()), 0.05003, 1e-7);
    EXPECT_THAT(realsense::parse_depth_table(test::depth_table(), 641, 480).error().text,
                HasSubstr("no entry for 641x480"));
    EXPECT_THAT(realsense::parse_depth_table(test::depth_table(), 848, 480).error().text, HasSubstr("is no camera"));
    EXPECT_THAT(realsense::parse_depth_table(test::color_table(), 640, 480).error().text,
                HasSubstr("bytes, needs 512"));
}

TEST(RealSense, TableWithPaddingBehindItIsReadByItsAnnouncedSize) {
    Bytes padded = test::depth_table();
    padded.resize(1016);
    EXPECT_TRUE(realsense::parse_depth_table(padded, 640, 480));
}

TEST(RealSense, EveryTruncationAndEveryFlippedBitIsRefused) {
    const Bytes whole = test::depth_table();
    for (std::size_t size = 0; size < whole.size(); ++size)
        EXPECT_FALSE(realsense::parse_depth_table(std::span(whole).first(size), 640, 480)) << size;
    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
        if (bit / 8 < 2 || (bit / 8 >= 8 && bit / 8 < 12)) continue;  // version and a field without meaning here
        Bytes flipped = whole;
        flipped[bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
        // The CRC covers all of the answer, whatever the size field says.
        const bool size_field = bit / 8 >= 4 && bit / 8 < 8;
        if (!size_field) {
            EXPECT_FALSE(realsense::parse_depth_table(flipped, 640, 480)) << bit;
        }
    }
}

TEST(RealSense, ColorTableGivesCameraAndPose) {
    const auto wide = realsense::parse_color_table(test::color_table(), 1280, 720);
    ASSERT_TRUE(wide) << wide.error().text;
    EXPECT_NEAR(wide->model.fx_px, 0.5 * 0.96 * 1280, 1e-4);
    EXPECT_NEAR(wide->model.fy_px, 0.5 * 1.70 * 720, 1e-4);
    EXPECT_NEAR(wide->model.cx_px, 0.5 * 1.01 * 1280, 1e-4);
    EXPECT_NEAR(wide->model.cy_px, 0.5 * 0.98 * 720, 1e-4);
    // 4:3 is a crop of 16:9 at the same pixels: focal lengths scale with the height alone.
    const auto vga = realsense::parse_color_table(test::color_table(), 640, 480);
    ASSERT_TRUE(vga);
    EXPECT_NEAR(vga->model.fx_px, wide->model.fx_px * 480 / 720, 1e-3);
    EXPECT_NEAR(vga->model.fy_px, wide->model.fy_px * 480 / 720, 1e-3);
    EXPECT_NEAR(vga->pose.rotation[1], -std::sin(0.01), 1e-6) << "stored by columns";
    EXPECT_NEAR(vga->pose.translation_m[0], -0.0147, 1e-7);
}

TEST(RealSense, PoseThatIsNoneIsRefused) {
    Bytes table = test::color_table();
    const auto with = [&](std::size_t at, float value) {
        Bytes changed = table;
        std::memcpy(changed.data() + at, &value, 4);
        const std::uint32_t crc = realsense::crc32(std::span(changed).subspan(16));
        std::memcpy(changed.data() + 12, &crc, 4);
        return realsense::parse_color_table(changed, 640, 480);
    };
    EXPECT_TRUE(with(224, 0.2f));
    EXPECT_FALSE(with(184, 2.0f)) << "no rotation";
    EXPECT_FALSE(with(220, NAN));
    EXPECT_FALSE(with(220, 5000.0f)) << "five metres apart";
    EXPECT_FALSE(with(16, NAN));
    EXPECT_FALSE(with(52, 1e9f));
}

// The device's polynomial undistorts, OpenCV's distorts: one after the other must be nothing.
TEST(RealSense, ForwardDistortionUndoesTheDevicesInverse) {
    const PinholeModel model{640, 480, 610, 612, 322, 238, {}};
    const std::array<double, 5> inverse{-0.055, 0.066, 0.0004, -0.0007, -0.021};
    const auto forward = realsense::forward_distortion(model, inverse);
    ASSERT_TRUE(forward) << forward.error().text;
    const auto brown = [](double x, double y, const std::array<double, 5>& k) {
        const double r2 = x * x + y * y, radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
        return std::pair(x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
                         y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y);
    };
    for (double u = 0; u <= 640; u += 53) {
        for (double v = 0; v <= 480; v += 53) {
            const double x = (u - model.cx_px) / model.fx_px, y = (v - model.cy_px) / model.fy_px;
            const auto [xu, yu] = brown(x, y, inverse);
            const auto [xd, yd] = brown(xu, yu, *forward);
            EXPECT_NEAR(xd * model.fx_px, x * model.fx_px, 0.05) << u << " " << v;
            EXPECT_NEAR(yd * model.fy_px, y * model.fy_px, 0.05) << u << " " << v;
        }
    }
}

TEST(RealSense, DepthUnitMustBePlausible) {
    EXPECT_DOUBLE_EQ(*realsense::parse_depth_unit(test::depth_control(1000)), 1e-3);
    EXPECT_FALSE(realsense::parse_depth_unit(test::depth_control(0)));
    EXPECT_FALSE(realsense::parse_depth_unit(test::depth_control(1'000'000)));
    EXPECT_FALSE(realsense::parse_depth_unit(Bytes(19)));
}

TEST(RealSense, AnswersOfNoiseAreSurvived) {
    std::mt19937 random(1);
    for (int i = 0; i < 2000; ++i) {
        Bytes noise(random() % 1100);
        for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random());
        EXPECT_FALSE(realsense::answer_data(0x10, noise));
        EXPECT_FALSE(realsense::parse_depth_table(noise, 640, 480));
        EXPECT_FALSE(realsense::parse_color_table(noise, 640, 480));
    }
}

TEST(RealSense, UnitThatIsNotThereOrFailsIsToldApart) {
    test::FakeCamera camera;
    const int fd = camera.open(camera.node().c_str(), 0);
    EXPECT_EQ(RealSense::attach(camera, fd).error().kind, ErrorKind::kInvalidInput);
    test::make_realsense(camera);
    auto unit = RealSense::attach(camera, fd);
    ASSERT_TRUE(unit);
    EXPECT_EQ(unit->identity()->serial, "842512070299");
    camera.tables.clear();
    EXPECT_THAT(unit->identity().error().text, HasSubstr("error -6"));
    camera.errors[UVCIOC_CTRL_QUERY] = {EINTR, EIO};
    const auto failed = unit->temperature_c();
    EXPECT_EQ(failed.error().kind, ErrorKind::kHostFault);
    EXPECT_THAT(failed.error().text, HasSubstr("selector 9: Input/output error"));
}

}  // namespace
}  // namespace teres
