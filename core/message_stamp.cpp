#include "core/message_stamp.h"

#include <algorithm>
#include <array>

#include "teres/boundary_estimate_t.hpp"
#include "teres/camera_info_t.hpp"
#include "teres/cut_t.hpp"
#include "teres/gap_t.hpp"
#include "teres/health_t.hpp"
#include "teres/image_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/registration_t.hpp"
#include "teres/surface_points_t.hpp"
#include "teres/tool_loads_t.hpp"
#include "teres/tracking_t.hpp"

namespace teres {
namespace {

std::int64_t big_endian(const std::uint8_t* bytes) noexcept {
    std::uint64_t value = 0;
    for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
    return static_cast<std::int64_t>(value);
}

}  // namespace

std::optional<MessageStamp> stamp_of(std::span<const std::uint8_t> data) noexcept {
    static const std::array known = {boundary_estimate_t::getHash(),
                                     camera_info_t::getHash(),
                                     gap_t::getHash(),
                                     health_t::getHash(),
                                     image_t::getHash(),
                                     innovation_t::getHash(),
                                     liver_state_t::getHash(),
                                     markers_t::getHash(),
                                     tool_loads_t::getHash(),
                                     tracking_t::getHash(),
                                     cut_t::getHash(),
                                     registration_t::getHash(),
                                     surface_points_t::getHash()};
    // LCM layout: hash, then the fields in order: capture_stamp_us, sequence, ...
    if (data.size() < 24) return std::nullopt;
    if (std::find(known.begin(), known.end(), big_endian(data.data())) == known.end()) return std::nullopt;
    return MessageStamp{big_endian(data.data() + 8), big_endian(data.data() + 16)};
}

}  // namespace teres
