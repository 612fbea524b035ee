// Model error carried to other instants, by hand.
#include "plugins/diagnosis/discrepancy.h"

#include <gtest/gtest.h>

namespace teres {
namespace {

TEST(Discrepancy, BetweenInstantsItIsInterpolatedBeyondThemItStays) {
    Discrepancy some;
    some.columns.resize(2 * 3, 1);  // two channels, three frames
    some.columns << 0.0, 1.0, 2.0, 5.0, 6.0, 1.0;
    some.remainder_m = Eigen::Vector3d(1.0, 3.0, 2.0);
    some.runs = 7;
    const Discrepancy all = at_times(some, {0.0, 0.4, 0.8}, {0.0, 0.1, 0.4, 0.6, 0.8, 1.0});
    Eigen::VectorXd columns(12), remainder(6);
    columns << 0.0, 1.0, 0.5, 2.0, 2.0, 5.0, 4.0, 3.0, 6.0, 1.0, 6.0, 1.0;
    remainder << 1.0, 1.5, 3.0, 2.5, 2.0, 2.0;
    EXPECT_LT((all.columns - columns).norm(), 1e-12) << all.columns.transpose();
    EXPECT_LT((all.remainder_m - remainder).norm(), 1e-12) << all.remainder_m.transpose();
    EXPECT_EQ(all.runs, 7);
}

}  // namespace
}  // namespace teres
