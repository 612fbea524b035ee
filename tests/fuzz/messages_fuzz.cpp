// The decoders of every message type: no crash, no exception, no more memory than the packet justifies; what
// is accepted encodes to a packet that decodes to the same bytes again.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <teres/boundary_estimate_t.hpp>
#include <teres/camera_info_t.hpp>
#include <teres/channel_health_t.hpp>
#include <teres/cut_t.hpp>
#include <teres/device_health_t.hpp>
#include <teres/gap_t.hpp>
#include <teres/header_t.hpp>
#include <teres/health_t.hpp>
#include <teres/image_t.hpp>
#include <teres/innovation_t.hpp>
#include <teres/liver_state_t.hpp>
#include <teres/markers_t.hpp>
#include <teres/pedal_t.hpp>
#include <teres/tool_loads_t.hpp>
#include <teres/tracking_t.hpp>
#include <teres/unit_health_t.hpp>
#include <vector>

#include "core/message_stamp.h"

namespace {

// The first bytes of a packet are the hash of its type: put in, so that the fuzzer need not guess them.
template <class Message>
void decode(const std::uint8_t* data, std::size_t size) {
    std::vector<std::uint8_t> packet(8 + size);
    const auto hash = static_cast<std::uint64_t>(Message::getHash());
    for (int i = 0; i < 8; ++i) packet[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(hash >> (56 - 8 * i));
    if (size > 0) std::memcpy(packet.data() + 8, data, size);
    Message message{};
    const int used = message.decode(packet.data(), 0, static_cast<int>(packet.size()));
    if (used < 0) return;
    if (used != message.getEncodedSize()) std::abort();
    std::vector<std::uint8_t> again(static_cast<std::size_t>(used));
    if (message.encode(again.data(), 0, used) != used) std::abort();
    if (std::memcmp(again.data(), packet.data(), again.size()) != 0) std::abort();
    teres::stamp_of(packet);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size == 0) return 0;
    const std::uint8_t type = data[0];
    ++data;
    --size;
    switch (type % 16) {
        case 0:
            decode<teres::markers_t>(data, size);
            break;
        case 1:
            decode<teres::tool_loads_t>(data, size);
            break;
        case 2:
            decode<teres::boundary_estimate_t>(data, size);
            break;
        case 3:
            decode<teres::liver_state_t>(data, size);
            break;
        case 4:
            decode<teres::innovation_t>(data, size);
            break;
        case 5:
            decode<teres::health_t>(data, size);
            break;
        case 6:
            decode<teres::channel_health_t>(data, size);
            break;
        case 7:
            decode<teres::unit_health_t>(data, size);
            break;
        case 8:
            decode<teres::image_t>(data, size);
            break;
        case 9:
            decode<teres::camera_info_t>(data, size);
            break;
        case 10:
            decode<teres::device_health_t>(data, size);
            break;
        case 11:
            decode<teres::pedal_t>(data, size);
            break;
        case 12:
            decode<teres::cut_t>(data, size);
            break;
        case 13:
            decode<teres::gap_t>(data, size);
            break;
        case 14:
            decode<teres::tracking_t>(data, size);
            break;
        default:
            decode<teres::header_t>(data, size);
            break;
    }
    return 0;
}
