#include "plugins/simulation/implicit_step.h"

#include <gtest/gtest.h>

#include <cmath>

#include "plugins/simulation/corotational.h"
#include "plugins/simulation/static_stvk.h"
#include "tests/plugins/simulation/peer_shapes.h"
#include "tests/support/differences.h"

namespace teres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using test::rest_positions;

constexpr double kStep = 0.01;
const std::vector<double> kModulus{4e3, 5e3, 6e3, 7e3, 8e3, 9e3};

StvkTets stvk(const TetMeshData& mesh) {
    auto body = StvkTets::make(mesh, 0.4);
    EXPECT_TRUE(body.has_value());
    return std::move(*body);
}

TetSystem make_system(const TetMeshData& mesh, std::vector<char> held = {}) {
    held.resize(mesh.nodes.size(), 0);
    auto system = TetSystem::make(std::make_unique<StvkTets>(stvk(mesh)), mass_from_density(mesh, 200.0), held);
    EXPECT_TRUE(system.has_value());
    return std::move(*system);
}

AnchorSpring pull(NodeIndex node, const Vector3d& anchor, double k) {
    AnchorSpring spring;
    spring.node = node;
    spring.anchor = anchor;
    spring.k[0] = k;
    return spring;
}

// Independent world: forces from the body and springs, stiffness by differences, dense matrices.
struct Dense {
    const TetMeshData mesh = test::distorted_cube();
    const StvkTets body = stvk(mesh);
    std::vector<AnchorSpring> springs{pull(7, Vector3d(0.06, 0.05, 0.07), 800.0)};
    VectorXd mass;
    Dense() {
        const VectorXd each = mass_from_density(mesh, 200.0);
        mass.resize(24);
        for (Index a = 0; a < 8; ++a) mass.segment<3>(3 * a).setConstant(each(a));
    }
    VectorXd force(const VectorXd& x) const {
        VectorXd f = VectorXd::Zero(24);
        body.add_force(x, kModulus, f);
        for (const auto& s : springs) f.segment<3>(3 * s.node) += s.force(x.segment<3>(3 * s.node));
        return f;
    }
    MatrixXd stiffness(const VectorXd& x) const {
        return test::jacobian([&](const VectorXd& y) -> VectorXd { return -force(y); }, x);
    }
};

TEST(StvkTets, ForceIsMinusEnergyGradientAndStiffnessItsDerivative) {
    const Dense dense;
    const VectorXd x = rest_positions(dense.mesh) + test::scatter(24, 0.006);
    VectorXd f = VectorXd::Zero(24);
    dense.body.add_force(x, kModulus, f);
    const auto energy = [&](const VectorXd& y) { return dense.body.energy(y, kModulus); };
    EXPECT_LT((f + test::gradient(energy, x)).norm(), 1e-6 * f.norm());
    TetSystem system = make_system(dense.mesh);
    std::vector<double> values(system.pattern.num_values(), 0.0);
    VectorXd ignored = VectorXd::Zero(24);
    system.body->add_force_and_stiffness(x, kModulus, system.pattern, ignored, values);
    const MatrixXd expected = test::jacobian(
        [&](const VectorXd& y) -> VectorXd {
            VectorXd g = VectorXd::Zero(24);
            dense.body.add_force(y, kModulus, g);
            return -g;
        },
        x);
    const VectorXd direction = test::scatter(24, 1.0, 0.7);
    VectorXd product = VectorXd::Zero(24);
    system.pattern.multiply(values, direction.data(), product.data());
    EXPECT_LT((product - expected * direction).norm(), 1e-6 * product.norm());
}

// ((1 + h rM) M + h (h + rK) S) dv = h (f - rM M v - (h + rK) S v), with S by differences.
TEST(ImplicitEuler, EqualsItsEquationSolvedDensely) {
    const Dense dense;
    TetSystem system = make_system(dense.mesh);
    system.rayleigh_mass = 0.7;
    system.rayleigh_stiffness = 0.03;
    Stepper stepper(system);
    MotionState state{rest_positions(dense.mesh) + test::scatter(24, 0.004), test::scatter(24, 0.3, 0.9), {}};
    const VectorXd x = state.x, v = state.v;
    const MatrixXd S = dense.stiffness(x);
    const double h = kStep, rM = 0.7, rK = 0.03;
    const MatrixXd M = dense.mass.asDiagonal();
    const VectorXd rhs = h * (dense.force(x) - rM * M * v - (h + rK) * S * v);
    const VectorXd dv = ((1.0 + h * rM) * M + h * (h + rK) * S).lu().solve(rhs);
    ASSERT_TRUE(stepper.implicit_euler({kModulus, dense.springs, nullptr}, h, 0.0, state));
    EXPECT_LT((state.v - (v + dv)).norm(), 1e-7 * state.v.norm());
    EXPECT_LT((state.x - (x + h * (v + dv))).norm(), 1e-9);
}

TEST(ImplicitMidpoint, EqualsItsEquationsSolvedDenselyOverTwoSteps) {
    const Dense dense;
    TetSystem system = make_system(dense.mesh);
    system.rayleigh_mass = 0.7;
    system.rayleigh_stiffness = 0.002;
    Stepper stepper(system);
    MotionState state{rest_positions(dense.mesh) + test::scatter(24, 0.002), test::scatter(24, 0.1, 0.9), {}};
    VectorXd x = state.x, v = state.v;
    const double h = kStep, rM = 0.7, rK = 0.002;
    const MatrixXd M = dense.mass.asDiagonal();
    VectorXd p = M * v;
    for (int k = 0; k < 2; ++k) {
        const MatrixXd S = dense.stiffness(x);
        const MatrixXd A = 4.0 / (h * h) * M + 4.0 * rM / h * M + (1.0 + 4.0 * rK / h) * S;
        const VectorXd d = A.lu().solve(dense.force(x) + 2.0 / h * p);
        v = 2.0 / h * d;
        p = M * v + h / 2.0 * dense.force(x + h / 2.0 * v);
        x += h * v;
        ASSERT_TRUE(stepper.implicit_midpoint({kModulus, dense.springs, nullptr}, h, 0.0, state));
    }
    EXPECT_LT((state.x - x).norm(), 1e-9);
    EXPECT_LT((state.v - v).norm(), 1e-6 * v.norm());
}

// Without elasticity every node is an oscillator on its spring: the midpoint keeps its energy, implicit Euler
// loses it.
TEST(ImplicitMidpoint, KeepsTheEnergyOfAnOscillator) {
    const auto mesh = test::single_tet();
    const VectorXd X = rest_positions(mesh);
    const std::vector<double> soft{1e-12};
    std::vector<AnchorSpring> springs;
    for (NodeIndex a = 0; a < 4; ++a) springs.push_back(pull(a, X.segment<3>(3 * a), 5.0));
    TetSystem system = make_system(mesh);
    const double m = system.node_mass(0), w = std::sqrt(5.0 / m);
    Stepper stepper(system);
    const auto energy = [&](const MotionState& s) {
        return 0.5 * m * s.v.squaredNorm() + 2.5 * (s.x - X).squaredNorm();
    };
    MotionState midpoint{X + test::scatter(12, 0.01), VectorXd::Zero(12), {}};
    MotionState euler = midpoint;
    const double start = energy(midpoint), h = 0.05 / w;
    for (int k = 0; k < 400; ++k) {
        ASSERT_TRUE(stepper.implicit_midpoint({soft, springs, nullptr}, h, 0.0, midpoint));
        ASSERT_TRUE(stepper.implicit_euler({soft, springs, nullptr}, h, 0.0, euler));
    }
    // v is that of the middle of the step, so the energy is out by h w / 2 = 2.5 % at most.
    EXPECT_NEAR(energy(midpoint) / start, 1.0, 0.03);
    // v' = (v - h w^2 x)/(1 + h^2 w^2): amplitude^2 falls by 1/(1 + (h w)^2) a step.
    EXPECT_NEAR(energy(euler) / start, std::pow(1.0 + 0.0025, -400), 0.03);
}

TEST(ImplicitEuler, FallsFreelyHoldsFixedNodesAndDampsVelocity) {
    const auto mesh = test::distorted_cube();
    {
        TetSystem system = make_system(mesh);
        system.gravity = Vector3d(0.0, 0.0, -9.81);
        Stepper stepper(system);
        MotionState state{rest_positions(mesh), VectorXd::Zero(24), {}};
        for (int k = 0; k < 10; ++k) ASSERT_TRUE(stepper.implicit_euler({kModulus, {}, nullptr}, kStep, 0.0, state));
        for (Index a = 0; a < 8; ++a) EXPECT_NEAR(state.v(3 * a + 2), -9.81 * 10 * kStep, 1e-9);
    }
    TetSystem system = make_system(mesh, {1, 0, 1, 0, 0, 0, 0, 0});
    Stepper stepper(system);
    const VectorXd push = test::scatter(24, 0.5);
    MotionState plain{rest_positions(mesh), VectorXd::Zero(24), {}}, damped = plain;
    ASSERT_TRUE(stepper.implicit_euler({kModulus, {}, &push}, kStep, 0.0, plain));
    ASSERT_TRUE(stepper.implicit_euler({kModulus, {}, &push}, kStep, 5.0, damped));
    EXPECT_EQ(plain.x.head(3), rest_positions(mesh).head(3));
    EXPECT_EQ(plain.x.segment(6, 3), rest_positions(mesh).segment(6, 3));
    EXPECT_GT(plain.v.norm(), 0.01);
    EXPECT_LT((damped.v - std::exp(-0.05) * plain.v).norm(), 1e-12);
    EXPECT_EQ(damped.x, plain.x);
}

TEST(StaticEquilibrium, BalancesForcesWithDirectSolverAndWithEnoughConjugateGradients) {
    const Dense dense;
    TetSystem system = make_system(dense.mesh, {1, 1, 1, 1, 0, 0, 0, 0});
    Stepper stepper(system);
    StaticOptions options;
    options.newton_iterations = 20;
    MotionState direct{rest_positions(dense.mesh), VectorXd::Zero(24), {}}, gradient = direct, truncated = direct;
    ASSERT_TRUE(stepper.static_equilibrium({kModulus, dense.springs, nullptr}, options, direct));
    EXPECT_LT(dense.force(direct.x).tail(12).norm(), 1e-7);
    EXPECT_GT((direct.x - rest_positions(dense.mesh)).norm(), 1e-3);
    options.cg_iterations = 200;
    options.cg_tolerance = 1e-14;
    ASSERT_TRUE(stepper.static_equilibrium({kModulus, dense.springs, nullptr}, options, gradient));
    EXPECT_LT((gradient.x - direct.x).norm(), 1e-8);
    options.newton_iterations = 1;
    options.cg_iterations = 2;
    ASSERT_TRUE(stepper.static_equilibrium({kModulus, dense.springs, nullptr}, options, truncated));
    EXPECT_GT((truncated.x - direct.x).norm(), 1e-5);
}

// After k steps the iterate minimises the energy over the Krylov space {b, A b, ..., A^(k-1) b}.
TEST(ConjugateGradient, TruncatedIterateIsBestInItsKrylovSpace) {
    const Dense dense;
    TetSystem system = make_system(dense.mesh, {1, 1, 1, 1, 0, 0, 0, 0});
    std::vector<double> values(system.pattern.num_values(), 0.0);
    VectorXd f = VectorXd::Zero(24);
    system.body->add_force_and_stiffness(rest_positions(dense.mesh), kModulus, system.pattern, f, values);
    MatrixXd A(12, 12);
    for (Index j = 0; j < 12; ++j) {
        const VectorXd unit = VectorXd::Unit(12, j);
        VectorXd column = VectorXd::Zero(12);
        system.pattern.multiply(values, unit.data(), column.data());
        A.col(j) = column;
    }
    const VectorXd b = test::scatter(12, 1.0);
    MatrixXd krylov(12, 4);
    krylov.col(0) = b.normalized();
    for (Index j = 1; j < 4; ++j) krylov.col(j) = (A * krylov.col(j - 1)).normalized();
    const VectorXd best = krylov * (krylov.transpose() * A * krylov).ldlt().solve(krylov.transpose() * b);
    VectorXd y;
    EXPECT_EQ(conjugate_gradient(system.pattern, values, b, 4, 1e-20, y), 4);
    EXPECT_LT((y - best).norm(), 1e-9 * best.norm());
}

TEST(TetSystem, RejectsMovingNodeWithoutMass) {
    auto mesh = test::single_tet();
    mesh.nodes.push_back({1.0, 1.0, 1.0});
    const auto system = TetSystem::make(std::make_unique<StvkTets>(stvk(mesh)), mass_from_density(mesh, 200.0),
                                        std::vector<char>(5, 0));
    ASSERT_FALSE(system.has_value());
    EXPECT_NE(system.error().text.find("node 4"), std::string::npos);
}

TEST(MassFromDensity, SumsToTheBody) {
    // |det| / 6 = 0.05 * 0.04 * 0.036 / 6 = 1.2e-5 m^3.
    EXPECT_NEAR(mass_from_density(test::single_tet(), 200.0).sum(), 2.4e-3, 1e-12);
}

}  // namespace
}  // namespace teres
