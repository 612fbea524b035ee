// The free layer is eliminated: energy, gradient and stiffness are those of the whole two-layer net at rest in it.
#include "plugins/simulation/spring_fan.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "plugins/simulation/anchor_spring.h"
#include "tests/support/differences.h"

namespace teres {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kHeight = 0.025;

// Five nodes of a strip, the middle one joined to the other four.
SpringFan five_node_fan(double diagonal = 0.5) {
    const std::vector<Vector3d> X{{0, 0, 0}, {0.012, 0, 0}, {-0.012, 0, 0.001}, {0, 0.011, 0}, {0, -0.010, 0}};
    const std::vector<Vector3d> n(5, Vector3d::UnitZ());
    return make_fans(X, n, {0, 1, 2, 3, 4}, {{1, 2, 3, 4}, {0}, {0}, {0}, {0}}, kHeight, diagonal,
                     {4.0 / (kHeight * kHeight), 0.0, 1.0})[0];
}

VectorXd rest(const SpringFan& fan) {
    VectorXd x(15);
    for (int k = 0; k < 5; ++k) x.segment<3>(3 * k) = fan.near[std::size_t(k)].anchor;
    return x;
}

struct Value {
    double energy = 0.0;
    VectorXd gradient;
};
Value evaluate(const SpringFan& fan, const VectorXd& x, double factor = 1.0) {
    Value v{0.0, VectorXd::Zero(x.size())};
    add_fan_gradient(fan, std::array{factor, factor, factor, factor}.data(), x.data(), v.gradient.data(), &v.energy, 1,
                     0, 1);
    return v;
}

MatrixXd stiffness(const SpringFan& fan, const VectorXd& x) {
    FanStiffness K;
    fan_stiffness(fan, Eigen::Map<const Positions>(x.data(), 3, x.size() / 3), K);
    MatrixXd all(15, 15);
    for (int a = 0; a < 5; ++a)
        for (int b = 0; b < 5; ++b) all.block<3, 3>(3 * a, 3 * b) = K.block(std::size_t(a), std::size_t(b));
    return all;
}

// Some springs taut and some slack in each draw.
VectorXd random_state(const SpringFan& fan, unsigned seed) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal(0.0, 0.003);
    VectorXd x = rest(fan);
    for (auto& v : x) v += normal(generator);
    return x;
}

TEST(SpringFan, GradientAndStiffnessAreDerivativesOfTheEnergy) {
    const SpringFan fan = five_node_fan();
    for (unsigned seed = 1; seed <= 20; ++seed) {
        VectorXd x = random_state(fan, seed);
        for (int k = 0; k < 5; ++k) x(3 * k + 2) -= 0.002;  // pulled on the whole
        const VectorXd g = test::gradient([&](const VectorXd& at) { return evaluate(fan, at).energy; }, x, 1e-6);
        EXPECT_GT(g.norm(), 1e-4);
        EXPECT_LT((evaluate(fan, x).gradient - g).norm(), 1e-5 * g.norm()) << seed;
        const MatrixXd K = test::jacobian([&](const VectorXd& at) { return evaluate(fan, at).gradient; }, x, 1e-8);
        EXPECT_LT((stiffness(fan, x) - K).norm(), 1e-4 * K.norm()) << seed;
        EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(stiffness(fan, x)).eigenvalues().minCoeff(), -1e-9);
    }
}

// The same net of springs as AnchorSpring knows them, its free node brought to rest by small steps down the gradient.
TEST(SpringFan, EqualsTheNetWithItsFreeNodeRelaxed) {
    const SpringFan fan = five_node_fan();
    for (unsigned seed = 1; seed <= 5; ++seed) {
        const VectorXd x = random_state(fan, seed);
        std::vector<AnchorSpring> net;
        double hold = 0.0;
        for (const bool is_near : {true, false})
            for (std::size_t k = 0; k < 5; ++k) {
                const auto& s = is_near ? fan.near[k] : fan.far[k];
                AnchorSpring spring;
                spring.law = AnchorLaw::kCubicTension;
                spring.anchor = is_near ? Vector3d(x.segment<3>(3 * Eigen::Index(k))) : s.anchor;
                spring.rest_length = s.rest_length_m;
                spring.k = {s.weight * fan.k[0], s.weight * fan.k[1], s.weight * fan.k[2]};
                net.push_back(spring);
                hold += 1e-3 * s.weight * fan.k[2];
            }
        Vector3d y = fan.middle;
        for (int i = 0; i < 200000; ++i) {
            Vector3d f = hold * (fan.middle - y);
            for (const auto& spring : net) f += spring.force(y);
            y += 0.02 * f;
        }
        double energy = 0.5 * hold * (y - fan.middle).squaredNorm();
        VectorXd gradient(15);
        for (const auto& spring : net) energy += spring.energy(y);
        for (Eigen::Index k = 0; k < 5; ++k) {
            AnchorSpring other = net[std::size_t(k)];
            std::swap(other.anchor, y);  // seen from x_k
            gradient.segment<3>(3 * k) = -other.force(x.segment<3>(3 * k));
            std::swap(other.anchor, y);
        }
        EXPECT_NEAR(evaluate(fan, x).energy, energy, 1e-9 * energy + 1e-15);
        EXPECT_LT((evaluate(fan, x).gradient - gradient).norm(), 1e-6 * gradient.norm() + 1e-12) << seed;
    }
}

// Small lift along n: two layers of stiffness 2 in series; by hand f = d, both with and without diagonals. Only the
// hold of the layer (0.1 % of it) is beside that. A straight column of f = d + d^3/h^2 at any lift.
TEST(SpringFan, StiffnessAlongTheNormalIsTheOneAskedFor) {
    for (const double diagonal : {0.0, 0.5}) {
        const SpringFan fan = five_node_fan(diagonal);
        const double d = 1e-6;
        VectorXd x = rest(fan);
        for (int k = 0; k < 5; ++k) x(3 * k + 2) -= d;
        double f = 0.0;
        const VectorXd g = evaluate(fan, x).gradient;
        for (int k = 0; k < 5; ++k) f -= g(3 * k + 2);
        EXPECT_NEAR(f, d, 4e-3 * d);
    }
    const SpringFan column = five_node_fan(0.0);
    VectorXd x = rest(column);
    const double d = 0.01;
    x(2) -= d;
    EXPECT_NEAR(-evaluate(column, x).gradient(2), d + d * d * d / (kHeight * kHeight), 2e-3 * d);
}

// Pressed, every spring is slack: no force, no energy, no stiffness; and the layer's node is still determined.
TEST(SpringFan, NeverPushes) {
    const SpringFan fan = five_node_fan();
    VectorXd x = rest(fan);
    for (int k = 0; k < 5; ++k) x(3 * k + 2) += 0.004;
    EXPECT_LT(evaluate(fan, x).gradient.norm(), 1e-12);
    EXPECT_LT(evaluate(fan, x).energy, 1e-15);
    EXPECT_TRUE(stiffness(fan, x).allFinite());
    EXPECT_LT(stiffness(fan, x).norm(), 1e-9);
}

// Lanes do not see each other.
TEST(SpringFan, EveryLaneEqualsItsOwnEvaluation) {
    const SpringFan fan = five_node_fan();
    constexpr std::size_t kLanes = 6, kStride = 8;
    std::vector<double> x(15 * kStride), g(x.size(), 0.0), energy(kStride, 0.0);
    for (std::size_t l = 0; l < kLanes; ++l) {
        const VectorXd state = random_state(fan, unsigned(l + 1));
        for (std::size_t d = 0; d < 15; ++d) x[d * kStride + l] = state(Eigen::Index(d));
    }
    for (const std::size_t first : {0u, 4u}) {
        std::array<double, 4> factor{};
        for (std::size_t l = 0; l < 4; ++l) factor[l] = double(first + l + 1);
        add_fan_gradient(fan, factor.data(), x.data(), g.data(), energy.data(), kStride, first, kLanes);
    }
    for (std::size_t l = 0; l < kLanes; ++l) {
        const Value alone = evaluate(fan, random_state(fan, unsigned(l + 1)), double(l + 1));
        EXPECT_NEAR(energy[l], alone.energy, 1e-12 * alone.energy + 1e-18);
        for (std::size_t d = 0; d < 15; ++d)
            EXPECT_NEAR(g[d * kStride + l], alone.gradient(Eigen::Index(d)), 1e-9 * alone.gradient.norm());
    }
    for (std::size_t d = 0; d < 15; ++d) EXPECT_EQ(g[d * kStride + 7], 0.0);
}

}  // namespace
}  // namespace teres
