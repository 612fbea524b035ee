// Fingerprint of a stream of messages: FNV-1a, 64 bit, over channel, length and bytes of each in order. Two
// runs with the same fingerprint published the same bits (it guards against chance, not against an
// adversary).
#pragma once

#include <cstdint>
#include <cstdio>
#include <span>
#include <string>
#include <string_view>

namespace teres {

class RunHash {
  public:
    /// [loop]
    void add(std::string_view channel, std::span<const std::uint8_t> data) noexcept {
        for (const char c : channel) byte(static_cast<std::uint8_t>(c));
        byte(0);
        for (int shift = 0; shift < 64; shift += 8)
            byte(static_cast<std::uint8_t>(static_cast<std::uint64_t>(data.size()) >> shift));
        for (const std::uint8_t b : data) byte(b);
    }
    std::uint64_t value() const noexcept { return hash_; }
    /// 16 hexadecimal digits.
    std::string text() const {
        char digits[17];
        std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(hash_));
        return digits;
    }

  private:
    void byte(std::uint8_t b) noexcept { hash_ = (hash_ ^ b) * 0x100000001b3u; }
    std::uint64_t hash_ = 0xcbf29ce484222325u;
};

}  // namespace teres
