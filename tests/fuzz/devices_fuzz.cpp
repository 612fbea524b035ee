// What devices say: answers and tables of the extension unit, HID reports. No crash, no value that is no
// camera; an accepted depth table carries its CRC.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "core/check.h"
#include "drivers/camera/realsense.h"
#include "drivers/usb/footswitch.h"

namespace {

void check(const teres::PinholeModel& model) {
    for (const double value : {model.fx_px, model.fy_px, model.cx_px, model.cy_px}) TERES_CHECK(std::isfinite(value));
    for (const double value : model.distortion) TERES_CHECK(std::isfinite(value));
}

// The CRC is put right, so that the fuzzer gets behind it.
std::vector<std::uint8_t> with_crc(std::span<const std::uint8_t> data) {
    std::vector<std::uint8_t> table(data.begin(), data.end());
    if (table.size() < 16) return table;
    const std::uint32_t crc = teres::realsense::crc32(std::span(table).subspan(16));
    std::memcpy(table.data() + 12, &crc, 4);
    return table;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace teres;
    if (size == 0) return 0;
    const std::uint8_t what = data[0];
    const std::span<const std::uint8_t> rest(data + 1, size - 1);
    switch (what % 5) {
        case 0:
            if (const auto answer = realsense::answer_data(realsense::kIdentity, rest)) {
                TERES_CHECK(answer->size() <= realsense::kPacketBytes);
                realsense::parse_identity(*answer);
            }
            break;
        case 1: {
            const auto table = with_crc(rest);
            if (const auto model = realsense::parse_depth_table(table, 640, 480)) check(*model);
            if (const auto baseline = realsense::parse_baseline_m(table))
                TERES_CHECK(*baseline > 0.0 && *baseline < 1.0);
            break;
        }
        case 2:
            if (const auto color = realsense::parse_color_table(with_crc(rest), 1280, 720)) check(color->model);
            break;
        case 3:
            if (const auto unit = realsense::parse_depth_unit(rest)) TERES_CHECK(*unit >= 1e-6 && *unit <= 0.1);
            break;
        default:
            if (const auto down = parse_pedals(rest)) TERES_CHECK(*down < 8);
            parse_usb_id({reinterpret_cast<const char*>(rest.data()), rest.size()});
            break;
    }
    return 0;
}
