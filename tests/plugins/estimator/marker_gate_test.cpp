#include "plugins/estimator/marker_gate.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "plugins/estimator/probability.h"

using namespace teres;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// n markers whose residuals are drawn from N(0, Y Y^T + R).
struct Frame {
    Innovation innovation;
    VectorXd noise;
    std::vector<std::uint8_t> present;
};

Frame consistent_frame(Eigen::Index markers, unsigned seed, double spread_m = 1e-3) {
    std::mt19937 engine(seed);
    std::normal_distribution<double> normal;
    Frame frame;
    frame.innovation.deviations = spread_m * MatrixXd::NullaryExpr(3 * markers, 2, [&] { return normal(engine); });
    frame.noise = VectorXd::Constant(3 * markers, 1e-6);
    const VectorXd w = VectorXd::NullaryExpr(2, [&] { return normal(engine); });
    frame.innovation.residual =
        frame.innovation.deviations * w + 1e-3 * VectorXd::NullaryExpr(3 * markers, [&] { return normal(engine); });
    frame.present.assign(static_cast<std::size_t>(markers), 1);
    return frame;
}

}  // namespace

TEST(MarkerGate, RejectsTheSwappedMarkerOnly) {
    Frame frame = consistent_frame(20, 1);
    frame.innovation.residual.segment(3 * 7, 3) += Eigen::Vector3d(0.02, 0.0, 0.0);
    const GateResult result = gate_markers(frame.innovation, frame.noise, frame.present, {});
    EXPECT_EQ(result.num_gated, 1);
    EXPECT_EQ(result.use[7], MarkerUse::kGated);
    EXPECT_EQ(result.use[6], MarkerUse::kUsed);
}

// Little common error, so that the markers of a frame are independent; then at most the stated share, and not
// far less: the scale of the frame's median is never below 1.
TEST(MarkerGate, GatesGoodMarkersAtTheStatedRate) {
    int gated = 0;
    const int frames = 400;
    for (int i = 0; i < frames; ++i) {
        const Frame frame = consistent_frame(20, 100 + static_cast<unsigned>(i), 1e-5);
        gated += gate_markers(frame.innovation, frame.noise, frame.present, {0.99, 0.5}).num_gated;
    }
    const double expected = 0.01 * 20 * frames;
    EXPECT_GT(gated, 0.3 * expected);
    EXPECT_LT(gated, 1.2 * expected);
}

TEST(MarkerGate, BlamesTheModelWhenMostMarkersAreOff) {
    Frame frame = consistent_frame(20, 3);
    for (Eigen::Index j = 0; j < 11; ++j)
        frame.innovation.residual.segment(3 * j, 3).setConstant(0.02 + 0.001 * static_cast<double>(j));
    const GateResult result = gate_markers(frame.innovation, frame.noise, frame.present, {});
    EXPECT_EQ(result.num_gated, 0);
    for (MarkerUse use : result.use) EXPECT_EQ(use, MarkerUse::kUsed);
}

TEST(MarkerGate, TooManyOutliersOverruleTheGate) {
    Frame frame = consistent_frame(20, 3);
    for (Eigen::Index j = 0; j < 7; ++j) frame.innovation.residual.segment(3 * j, 3).setConstant(0.05);
    const GateResult strict = gate_markers(frame.innovation, frame.noise, frame.present, {0.9999, 0.3});
    EXPECT_TRUE(strict.overruled);
    EXPECT_EQ(strict.num_gated, 0);
    EXPECT_EQ(gate_markers(frame.innovation, frame.noise, frame.present, {0.9999, 0.5}).num_gated, 7);
}

TEST(MarkerGate, LostMarkersAreMissingNotOutliers) {
    Frame frame = consistent_frame(6, 4);
    frame.present[2] = 0;
    frame.innovation.residual.segment(6, 3).setConstant(std::numeric_limits<double>::quiet_NaN());
    const GateResult result = gate_markers(frame.innovation, frame.noise, frame.present, {});
    EXPECT_EQ(result.use[2], MarkerUse::kMissing);
    EXPECT_EQ(result.num_gated, 0);
    EXPECT_GT(result.sigma[2], 1e-3);
    frame.present.assign(6, 0);
    EXPECT_EQ(gate_markers(frame.innovation, frame.noise, frame.present, {}).use[0], MarkerUse::kMissing);
}
