#include "core/camera/depth_codec.h"

#include <gtest/gtest.h>

#include <random>

namespace teres {
namespace {

using Depth = std::vector<std::uint16_t>;

TEST(DepthCodec, RoundTripKeepsEveryBit) {
    std::mt19937 random(3);
    for (int trial = 0; trial < 200; ++trial) {
        Depth depth(1 + random() % 3000);
        std::uint16_t value = 3000;
        for (auto& d : depth) {
            if (random() % 30 == 0) value = static_cast<std::uint16_t>(random());
            d = random() % 5 == 0 ? 0 : static_cast<std::uint16_t>(value + random() % 40);
        }
        std::vector<std::uint8_t> code;
        encode_depth(depth, code);
        Depth back(depth.size(), 7);
        ASSERT_TRUE(decode_depth(code, back));
        EXPECT_EQ(back, depth);
    }
}

TEST(DepthCodec, HostileBytesAreRefusedOrFitTheImage) {
    std::mt19937 random(4);
    Depth depth(500);
    EXPECT_FALSE(decode_depth({}, depth));
    for (int trial = 0; trial < 20000; ++trial) {
        std::vector<std::uint8_t> code(random() % 200);
        for (auto& byte : code) byte = static_cast<std::uint8_t>(random());
        decode_depth(code, depth);  // address sanitizer watches
    }
    std::vector<std::uint8_t> code;
    encode_depth(Depth(500, 1234), code);
    code.pop_back();
    EXPECT_FALSE(decode_depth(code, depth)) << "half a frame";
    encode_depth(Depth(501, 1234), code);
    EXPECT_FALSE(decode_depth(code, depth)) << "a frame of another size";
}

}  // namespace
}  // namespace teres
