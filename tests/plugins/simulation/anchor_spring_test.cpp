#include "plugins/simulation/anchor_spring.h"

#include <gtest/gtest.h>

#include "tests/support/differences.h"

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const Vector3d kNode(0.10, 0.20, 0.05);

AnchorSpring make(AnchorLaw law) {
    AnchorSpring spring;
    spring.law = law;
    spring.anchor = kNode + Vector3d(0.004, 0.021, -0.013);  // L = 25.02 mm
    spring.rest_length = 0.02;
    switch (law) {
        case AnchorLaw::kRestShape:
            spring.k = {150.0, 0.0, 0.0};
            break;
        case AnchorLaw::kCubicTension:
            spring.k = {4e6, 2e4, 80.0};
            break;
        default:
            spring.k = {30.0, 500.0, 3000.0};
    }
    return spring;
}

class EveryAnchorSpring : public testing::TestWithParam<AnchorLaw> {};

TEST_P(EveryAnchorSpring, ForceIsMinusEnergyGradient) {
    AnchorSpring spring = make(GetParam());
    spring.smooth_scale = 1e9;  // L = 25 mm: the smoothing is exp(-6e5)
    const Vector3d f = spring.force(kNode);
    ASSERT_GT(f.norm(), 0.1);
    const auto energy = [&](const Vector3d& x) { return spring.energy(x); };
    EXPECT_LT((f + Vector3d(test::gradient(energy, kNode))).norm(), 1e-6 * f.norm());
}

TEST_P(EveryAnchorSpring, StiffnessIsMinusForceDerivative) {
    AnchorSpring spring = make(GetParam());
    spring.smooth_scale = 2000.0;  // c L^2 = 1.25: in the middle of the smoothing
    spring.smooth_shift = -7.0;
    const Matrix3d S = spring.stiffness(kNode);
    const auto minus_force = [&](const Vector3d& x) -> Vector3d { return -spring.force(x); };
    EXPECT_LT((S - test::jacobian(minus_force, kNode)).norm(), 1e-6 * S.norm());
}

INSTANTIATE_TEST_SUITE_P(Laws, EveryAnchorSpring,
                         testing::Values(AnchorLaw::kRestShape, AnchorLaw::kPolynomialTension, AnchorLaw::kCubicTension,
                                         AnchorLaw::kPolynomialRestShape));

TEST(AnchorSpring, RestShapePushesAndPulls) {
    AnchorSpring spring = make(AnchorLaw::kRestShape);
    spring.anchor = Vector3d::Zero();
    EXPECT_EQ(spring.force(Vector3d(0.01, -0.02, 0.0)), Vector3d(-1.5, 3.0, 0.0));
}

// By hand: L = 24 mm, e = 0.2, F = 30*0.2 + 500*0.04 + 3000*0.008 = 50 N; S along = (30 + 200 + 360)/0.02 =
// 29500 N/m.
TEST(AnchorSpring, PolynomialTensionMatchesPenAndPaper) {
    AnchorSpring spring = make(AnchorLaw::kPolynomialTension);
    spring.anchor = Vector3d(0.0, 0.024, 0.0);
    EXPECT_LT((spring.force(Vector3d::Zero()) - Vector3d(0.0, 50.0, 0.0)).norm(), 1e-9);
    EXPECT_NEAR(spring.stiffness(Vector3d::Zero())(1, 1), 29500.0, 1e-6);
    EXPECT_NEAR(spring.stiffness(Vector3d::Zero())(0, 0), 50.0 / 0.024, 1e-6);
}

// By hand: delta = 2 mm, f = 4e6 * 8e-9 + 2e4 * 4e-6 + 80 * 2e-3 = 0.032 + 0.08 + 0.16 N.
TEST(AnchorSpring, CubicTensionMatchesPenAndPaper) {
    AnchorSpring spring = make(AnchorLaw::kCubicTension);
    spring.anchor = Vector3d(0.022, 0.0, 0.0);
    EXPECT_LT((spring.force(Vector3d::Zero()) - Vector3d(0.272, 0.0, 0.0)).norm(), 1e-12);
}

TEST(AnchorSpring, TensionOnlyLawsAreSlackWhenShort) {
    for (const AnchorLaw law : {AnchorLaw::kPolynomialTension, AnchorLaw::kCubicTension}) {
        AnchorSpring spring = make(law);
        spring.anchor = Vector3d(0.0, 0.0, 0.018);
        EXPECT_EQ(spring.force(Vector3d::Zero()), Vector3d::Zero());
        EXPECT_EQ(spring.stiffness(Vector3d::Zero()), Matrix3d::Zero());
        EXPECT_EQ(spring.energy(Vector3d::Zero()), 0.0);
        spring.anchor.setZero();  // no direction
        EXPECT_TRUE(spring.force(Vector3d::Zero()).isZero());
        EXPECT_TRUE(spring.stiffness(Vector3d::Zero()).isZero());
    }
}

// The peer's tangent of a slack spring: e = |0.018 - 0.02|/0.02 = 0.1, F = 11 N, F' = 30 + 100 + 90 = 220 N.
TEST(AnchorSpring, PeersSlackTangentIsAnOption) {
    AnchorSpring spring = make(AnchorLaw::kPolynomialTension);
    spring.stiff_when_slack = true;
    spring.anchor = Vector3d(0.0, 0.0, 0.018);
    const Matrix3d S = spring.stiffness(Vector3d::Zero());
    EXPECT_EQ(spring.force(Vector3d::Zero()), Vector3d::Zero());
    EXPECT_NEAR(S(2, 2), 220.0 / 0.02, 1e-8);
    EXPECT_NEAR(S(0, 0), 11.0 / 0.018, 1e-8);
}

TEST(AnchorSpring, PolynomialRestShapeIsDefinedAtItsAnchor) {
    AnchorSpring spring = make(AnchorLaw::kPolynomialRestShape);
    spring.anchor = kNode;
    EXPECT_TRUE(spring.force(kNode).isZero());
    EXPECT_TRUE(spring.stiffness(kNode).allFinite());
}

// The peer keeps only the diagonal, with the slope of the direction applied to the whole radial part.
TEST(AnchorSpring, PeersDiagonalTangentIsDiagonalAndExactOnAnAxisFarAway) {
    AnchorSpring spring = make(AnchorLaw::kPolynomialRestShape);
    spring.smooth_scale = 1e9;
    spring.anchor = kNode + Vector3d(0.0, 0.03, 0.0);
    const Matrix3d exact = spring.stiffness(kNode);
    spring.diagonal_stiffness = true;
    EXPECT_LT((spring.stiffness(kNode) - exact).norm(), 1e-9 * exact.norm());
    spring.anchor = kNode + Vector3d(0.01, 0.03, -0.02);
    const Matrix3d S = spring.stiffness(kNode);
    EXPECT_EQ(S(0, 1), 0.0);
    EXPECT_EQ(S(2, 1), 0.0);
}

}  // namespace
}  // namespace teres
