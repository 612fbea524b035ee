// What amplitudes, places and times cost, by hand.
#include "plugins/diagnosis/amplitude_price.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

namespace teres {
namespace {

// A delay and a breathing organ of twelve amplitudes: one and seven directions count, not fourteen of both together.
TEST(AmplitudePrice, AmplitudesCountPerEffect) {
    const Eigen::MatrixXd S = Eigen::VectorXd::Constant(13, std::exp(2.0) - 1.0).asDiagonal();
    EXPECT_NEAR(occam_price(S, counted_amplitudes(1) + counted_amplitudes(12)), 8.0, 1e-12);
}

// Twelve small amplitudes do not pay for the large ones that they might have been; one at its prior's size pays as
// ever.
TEST(AmplitudePrice, AmplitudesShareAScale) {
    const auto vector = [](Eigen::Index size, double value) {
        return Eigen::VectorXd(Eigen::VectorXd::Constant(size, value));
    };
    const auto unit = [](Eigen::Index size, double value) {
        return Eigen::MatrixXd(value * Eigen::MatrixXd::Identity(size, size));
    };
    const std::vector<std::pair<double, double>> prior{{1.0, 0.7}, {0.5, 0.1}, {0.25, 0.1}, {0.125, 0.1}};
    double sum = 0.0;
    for (const auto& [s, p] : prior) sum += p / std::sqrt(1.0 + 63.0 * s * s);
    const AmplitudePrice none = amplitude_price({vector(1, 0.0)}, unit(1, 63.0), 1);
    EXPECT_NEAR(none.tail, 0.0, 1e-12);
    EXPECT_NEAR(none.occam, -std::log(sum), 1e-12);

    const AmplitudePrice small = amplitude_price({vector(12, 0.03)}, unit(12, 1e6), 7),
                         large = amplitude_price({vector(12, 1.0)}, unit(12, 1e6), 7);
    EXPECT_LT(small.tail + small.occam, 7.0 * std::log(1e3) - 9.0);
    EXPECT_NEAR(large.tail + large.occam, tail_price(vector(12, 1.0)) + 7.0 * std::log(1e3), 0.5);

    // Of two effects each has its own: the price of both is the sum where neither is seen in the other.
    Eigen::MatrixXd both = Eigen::MatrixXd::Zero(3, 3);
    both(0, 0) = 1e4;
    both.bottomRightCorner<2, 2>() = unit(2, 1e2);
    const AmplitudePrice first = amplitude_price({vector(1, 0.05)}, unit(1, 1e4), 1),
                         second = amplitude_price({vector(2, 1.0)}, unit(2, 1e2), 2),
                         pair = amplitude_price({vector(1, 0.05), vector(2, 1.0)}, both, 3);
    EXPECT_NEAR(pair.tail + pair.occam, first.tail + first.occam + second.tail + second.occam, 1e-9);
}

// |I + S| = 27 with the place, 4 without it.
TEST(AmplitudePrice, APlaceThatIsFittedNarrowlyHasItsPrice) {
    const Eigen::Matrix2d S{{3.0, 3.0}, {3.0, 8.0}};
    EXPECT_NEAR(narrowing_price(S, 1), 0.5 * std::log(27.0 / 4.0), 1e-12);
    EXPECT_NEAR(narrowing_price(Eigen::Matrix2d{{3.0, 0.0}, {0.0, 0.0}}, 1), 0.0, 1e-12) << "not seen: not narrowed";
}

}  // namespace
}  // namespace teres
