// Capture stamp and sequence number of any of our messages without decoding it: every type begins with
// header_t.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace teres {

struct MessageStamp {
    std::int64_t capture_us = 0;
    std::int64_t sequence = 0;
};

/// [loop] Nothing if the bytes are not one of the types of core/messages.
std::optional<MessageStamp> stamp_of(std::span<const std::uint8_t> data) noexcept;

}  // namespace teres
