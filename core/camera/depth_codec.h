// Lossless depth frames, fourcc "RVL ": runs of zeros and of values; values as differences in 3-bit groups (A. D.
// Wilson, Fast lossless depth image compression, ISS 2017). About a quarter of the raw size.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace teres {

/// [loop] Appends nothing, replaces `code`.
void encode_depth(std::span<const std::uint16_t> depth, std::vector<std::uint8_t>& code);
/// [loop] False unless `code` holds exactly depth.size() values; never reads or writes outside of the spans.
bool decode_depth(std::span<const std::uint8_t> code, std::span<std::uint16_t> depth) noexcept;

}  // namespace teres
