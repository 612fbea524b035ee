// Answers of a RealSense D435 to the commands of its extension unit, written down from their layout.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <span>

#include "drivers/camera/realsense.h"

namespace teres::test {

class TableWriter {
  public:
    TableWriter(std::uint16_t type, std::size_t bytes) : bytes_(bytes) {
        put(2, type);
        put(4, static_cast<std::uint32_t>(bytes - 16));
    }
    template <class T>
    TableWriter& put(std::size_t at, T value) {
        std::memcpy(bytes_.data() + at, &value, sizeof value);
        return *this;
    }
    TableWriter& floats(std::size_t at, std::initializer_list<float> values) {
        for (const float value : values) {
            put(at, value);
            at += 4;
        }
        return *this;
    }
    realsense::Bytes done() {
        put(12, realsense::crc32(std::span(bytes_).subspan(16)));
        return bytes_;
    }

  private:
    realsense::Bytes bytes_;
};

inline realsense::Bytes depth_table() {
    return TableWriter(25, 512)
        .floats(160, {-50.03f})                                  // baseline [mm]
        .floats(256 + 2 * 16, {386.5f, 386.7f, 321.2f, 239.4f})  // 640x480
        .done();
}

// fx = 1.4 / 2 * 1280 ... for 16:9; rotation by a small angle about z, stored by columns.
inline realsense::Bytes color_table(std::initializer_list<float> distortion = {0, 0, 0, 0, 0}) {
    const float c = std::cos(0.01f), s = std::sin(0.01f);
    return TableWriter(32, 256)
        .floats(16, {0.96f, 0, 0.01f, 0, 1.70f, -0.02f, 0, 0, 1})
        .floats(52, distortion)
        .put<std::uint16_t>(144, 1920)
        .put<std::uint16_t>(146, 1080)
        .floats(184, {c, s, 0, -s, c, 0, 0, 0, 1})
        .floats(220, {14.7f, 0.1f, 0.3f})
        .done();
}

inline realsense::Bytes identity_block() {
    realsense::Bytes data(256);
    const std::uint8_t firmware[4] = {1, 0, 16, 5}, serial[6] = {0x84, 0x25, 0x12, 0x07, 0x02, 0x99};
    std::memcpy(data.data() + 12, firmware, 4);
    std::memcpy(data.data() + 48, serial, 6);
    std::memcpy(data.data() + 64, "\x12\x34\x56\x78\x9a\xbc", 6);
    return data;
}

inline realsense::Bytes depth_control(std::uint32_t unit_um) {
    realsense::Bytes data(20);
    std::memcpy(data.data(), &unit_um, 4);
    return data;
}

}  // namespace teres::test
