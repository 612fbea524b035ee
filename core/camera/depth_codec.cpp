#include "core/camera/depth_codec.h"

#include <cstddef>

namespace teres {
namespace {

// Nibbles, high half of a byte first; the highest bit of a nibble says that the number goes on.
class NibbleWriter {
  public:
    explicit NibbleWriter(std::vector<std::uint8_t>& to) : to_(to) {}
    void put(std::uint32_t value) {
        do {
            const auto nibble = static_cast<std::uint8_t>((value & 7U) | (value > 7U ? 8U : 0U));
            if (half_)
                to_.back() = static_cast<std::uint8_t>(to_.back() | nibble);
            else
                to_.push_back(static_cast<std::uint8_t>(nibble << 4));
            half_ = !half_;
            value >>= 3;
        } while (value != 0);
    }

  private:
    std::vector<std::uint8_t>& to_;
    bool half_ = false;
};

class NibbleReader {
  public:
    explicit NibbleReader(std::span<const std::uint8_t> from) : from_(from) {}
    bool get(std::uint32_t& value) {
        value = 0;
        for (unsigned shift = 0; shift <= 30; shift += 3) {
            if (at_ / 2 >= from_.size()) return false;
            const std::uint32_t byte = from_[at_ / 2], nibble = at_ % 2 == 0 ? byte >> 4 : byte & 15U;
            ++at_;
            value |= (nibble & 7U) << shift;
            if (nibble < 8U) return true;
        }
        return false;
    }
    bool at_end() const { return (at_ + 1) / 2 == from_.size(); }

  private:
    std::span<const std::uint8_t> from_;
    std::size_t at_ = 0;
};

}  // namespace

void encode_depth(std::span<const std::uint16_t> depth, std::vector<std::uint8_t>& code) {
    code.clear();
    NibbleWriter out(code);
    std::int32_t previous = 0;
    for (std::size_t i = 0; i < depth.size();) {
        std::size_t end = i;
        while (end < depth.size() && depth[end] == 0) ++end;
        out.put(static_cast<std::uint32_t>(end - i));
        i = end;
        while (end < depth.size() && depth[end] != 0) ++end;
        out.put(static_cast<std::uint32_t>(end - i));
        for (; i < end; ++i) {
            const std::int32_t delta = depth[i] - previous;
            out.put(static_cast<std::uint32_t>((delta << 1) ^ (delta >> 31)));  // sign into the lowest bit
            previous = depth[i];
        }
    }
}

bool decode_depth(std::span<const std::uint8_t> code, std::span<std::uint16_t> depth) noexcept {
    NibbleReader in(code);
    std::int32_t previous = 0;
    for (std::size_t i = 0; i < depth.size();) {
        std::uint32_t zeros = 0, values = 0;
        if (!in.get(zeros) || zeros > depth.size() - i) return false;
        for (std::uint32_t k = 0; k < zeros; ++k) depth[i++] = 0;
        if (!in.get(values) || values > depth.size() - i || (zeros == 0 && values == 0)) return false;
        for (std::uint32_t k = 0; k < values; ++k) {
            std::uint32_t delta = 0;
            if (!in.get(delta) || delta > 0x3ffffU) return false;
            previous += static_cast<std::int32_t>(delta >> 1) ^ -static_cast<std::int32_t>(delta & 1U);
            if (previous <= 0 || previous > 0xffff) return false;
            depth[i++] = static_cast<std::uint16_t>(previous);
        }
    }
    return in.at_end();
}

}  // namespace teres
