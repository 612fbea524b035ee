// Where effects are tried beside what took up too much of what is missing.
#include "plugins/diagnosis/beginnings.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

using Toy = test::ToyBody;

// A tilt is 0.4 N per axis, a modulus a factor of exp(0.5), one way or the other: more than two of that starts anew
// with one, the same way.
TEST(Beginnings, WhatIsFarFromUsualStartsAnew) {
    Toy body;
    const EffectTable effects(body, nullptr, {});
    const Simulator simulator(body, nullptr, effects);
    const std::size_t gravity = effects.find("gravity"), modulus = effects.find("stiffness");
    const auto usual =
        at_usual_size(simulator, {{38.0, 70.0}, {{gravity, {0.79, -2.0, 3.0}}, {modulus, {std::exp(-0.9)}}}});
    ASSERT_TRUE(usual);
    EXPECT_NEAR(usual->theta[0], 38.0, 1e-9);
    EXPECT_NEAR(usual->theta[1], 70.0, 1e-9);
    EXPECT_NEAR(usual->effects[0].values[0], 0.79, 1e-12);
    EXPECT_NEAR(usual->effects[0].values[1], -0.4, 1e-12);
    EXPECT_NEAR(usual->effects[0].values[2], 0.4, 1e-12);
    EXPECT_NEAR(usual->effects[1].values[0], std::exp(-0.9), 1e-12);
    EXPECT_FALSE(at_usual_size(simulator, {{38.0, 70.0}, {{gravity, {0.79, -0.79, 0.0}}}}));
}

// Each effect as it clearly explains more, with what is known beside it; best first.
TEST(Beginnings, WhatIsTriedTwiceStartsWhereItExplainsMore) {
    const auto tried = [](std::size_t entry, double score, std::vector<ActiveEffect> beside) {
        EffectScreening effect;
        effect.entry = entry;
        effect.score = score;
        effect.beside = std::move(beside);
        return effect;
    };
    const std::vector<ActiveEffect> usual{{9, {1.0}}};
    const auto best = better_of({tried(0, 5.0, {}), tried(1, 3.0, {})},
                                {tried(0, 6.0, usual), tried(1, 9.0, usual), tried(2, 1.0, usual)});
    ASSERT_EQ(best.size(), 3u);
    EXPECT_EQ(best[0].entry, 1u);
    EXPECT_EQ(best[0].beside, usual);
    EXPECT_EQ(best[1].entry, 0u);
    EXPECT_TRUE(best[1].beside.empty());
    EXPECT_EQ(best[2].entry, 2u);
}

}  // namespace
}  // namespace teres
