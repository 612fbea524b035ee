#include "plugins/simulation/tether.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "plugins/simulation/ligament.h"
#include "tests/support/differences.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

constexpr std::size_t kLanes = 4;
using Eigen::Vector3d;

std::vector<Tether> one_of_each() {
    Tether band;
    band.band = {Vector3d(0.1, 0.0, 0.02), Vector3d(1, 2, 2) / 3.0, 0.3, 0.02};
    band.share = 0.7;
    band.parameter = 0;
    Tether cubic = band;
    cubic.kind = Tether::Kind::kSpring;
    cubic.spring.law = AnchorLaw::kCubicTension;
    cubic.spring.anchor = Vector3d(0.1, 0.02, 0.03);
    cubic.spring.k = {2e5, 3e3, 80.0};
    cubic.spring.rest_length = 0.02;
    Tether bar = cubic;
    bar.kind = Tether::Kind::kBar;
    bar.spring.k = {90.0, 0.0, 0.0};
    Tether slack = band;
    slack.band.dead_zone_m = 0.003;
    return {band, cubic, bar, slack};
}

struct Value {
    double energy;
    Vector3d gradient;
};
Value evaluate(const Tether& t, const Vector3d& x, double theta) {
    std::vector<double> batch(3 * kLanes), gradient(batch.size(), 0.0), energy(kLanes, 0.0), factor(kLanes, theta);
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t l = 0; l < kLanes; ++l) batch[a * kLanes + l] = x(static_cast<Eigen::Index>(a));
    add_tether_gradient({t}, factor.data(), batch.data(), gradient.data(), energy.data(), kLanes, kLanes);
    return {energy[0], {gradient[0], gradient[kLanes], gradient[2 * kLanes]}};
}

TEST(Tether, GradientAndStiffnessAreDerivativesOfEnergy) {
    const Vector3d x(0.104, -0.006, 0.013);  // stretches spring and bar
    for (const auto& t : one_of_each()) {
        const double theta = 1.7;
        const auto energy = [&](const Eigen::VectorXd& at) { return evaluate(t, at, theta).energy; };
        const auto gradient = [&](const Eigen::VectorXd& at) -> Eigen::VectorXd {
            return evaluate(t, at, theta).gradient;
        };
        const Eigen::VectorXd expected = test::gradient(energy, x);
        EXPECT_GT(expected.norm(), 1e-3);
        EXPECT_LT((evaluate(t, x, theta).gradient - expected).norm(), 1e-6 * expected.norm());
        const Eigen::MatrixXd K = test::jacobian(gradient, x);
        EXPECT_LT((theta * tether_stiffness(t, x) - K).norm(), 1e-6 * K.norm());
    }
}

// By hand, along the spring: d = 5 mm, f = 2e5 (0.005)^3 + 3e3 (0.005)^2 + 80 (0.005) = 0.025 + 0.075 + 0.4 =
// 0.5 N; slack: 0.
TEST(Tether, CubicStringPullsAndNeverPushes) {
    Tether t = one_of_each()[1];
    t.share = 1.0;
    const Vector3d n(0, 0, 1);
    EXPECT_NEAR(evaluate(t, t.spring.anchor - 0.025 * n, 1.0).gradient.z(), -0.5, 1e-12);
    EXPECT_EQ(evaluate(t, t.spring.anchor - 0.015 * n, 1.0).gradient.norm(), 0.0);
}

// By hand: a band of 20 mm that is 3 mm longer. Drawn 5 mm away from its far edge the string pulls with w k (5 - 3) mm
// beside what stays solid; pushed 5 mm towards it, it does nothing.
TEST(Tether, SlackBandPullsBeyondItsDeadZoneAndNeverPushes) {
    const Tether t = one_of_each()[3];
    const double solid = std::exp(-3.0), w = t.share;
    const Vector3d n = t.band.normal;
    EXPECT_NEAR(evaluate(t, t.band.rest - 0.005 * n, 1.0).gradient.dot(n), -w * (solid * 0.005 + (1.0 - solid) * 0.002),
                1e-12);
    EXPECT_NEAR(evaluate(t, t.band.rest + 0.005 * n, 1.0).gradient.dot(n), w * solid * 0.005, 1e-12);
}

Case block_with_prior() {
    Case c = test::clamped_block({.size_m = {0.10, 0.04, 0.04}, .cells = {8, 4, 4}});
    for (const auto node : c.clamped) c.ligament_prior.push_back({node, node % 2 == 0 ? 0.9 : 0.3});
    return c;
}

// Shares of a group sum to one; the prior median meets P(theta > threshold) = group probability on the
// log-normal prior.
TEST(Ligament, GroupsCarryTheAtlasProbability) {
    const Case c = block_with_prior();
    const TetMesh mesh = *TetMesh::make(c.mesh);
    const LigamentData data{LigamentLaw::kNeoHookean, 1e5, 0.45, 0.025, 0.02, 0.0};
    for (const std::string model : {"band", "cubic_springs"}) {
        LigamentSettings s;
        s.num_groups = 4;
        s.model = model;
        const Ligament ligament = make_ligament(mesh, c.ligament_prior, data, s);
        ASSERT_EQ(ligament.groups.size(), 4u);
        std::vector<double> share(4, 0.0);
        for (const auto& t : ligament.tethers) share[static_cast<std::size_t>(t.parameter)] += t.share;
        for (std::size_t g = 0; g < 4; ++g) {
            const auto& group = ligament.groups[g];
            EXPECT_NEAR(share[g], 1.0, 1e-12);
            EXPECT_NEAR(group.full_stiffness_n_per_m, 1e5 * group.area_m2 / 0.025, 1e-9 * group.full_stiffness_n_per_m);
            const double z = (std::log(group.prior_median_n_per_m) - std::log(group.threshold_n_per_m)) / s.log_stdev;
            EXPECT_NEAR(0.5 * std::erfc(-z / std::sqrt(2.0)), group.prior_probability, 1e-9);
        }
    }
}

// Shares within one group, by hand: area p^sharpness exp(lean s), s the place across a face of 60 x 30 mm (along z) in
// standard deviations. Groups stay those of the atlas.
TEST(Ligament, LeansAcrossTheRegionAndNarrows) {
    Case c = test::clamped_block({.size_m = {0.10, 0.06, 0.03}, .cells = {5, 6, 4}});
    for (const auto node : c.clamped)
        c.ligament_prior.push_back({node, 0.3 + 0.5 * c.mesh.nodes[static_cast<std::size_t>(node)][1] / 0.06});
    const TetMesh mesh = *TetMesh::make(c.mesh);
    const LigamentData data{LigamentLaw::kNeoHookean, 1e5, 0.45, 0.025, 0.02, 0.0};
    LigamentSettings plain;
    plain.num_groups = 1;
    LigamentSettings lean = plain, narrow = plain;
    lean.lean = 0.5;
    narrow.sharpness = 2.0;
    const Ligament a = make_ligament(mesh, c.ligament_prior, data, plain),
                   b = make_ligament(mesh, c.ligament_prior, data, lean),
                   n = make_ligament(mesh, c.ligament_prior, data, narrow);
    double mean = 0.0, square = 0.0;
    for (const auto& t : a.tethers) {
        const double z = mesh.X(2, t.node);
        mean += t.share * z;
        square += t.share * z * z;
    }
    const double stdev = std::sqrt(square - mean * mean);
    const auto log_ratio = [&](const Ligament& l, std::size_t i) {
        return std::log(l.tethers[i].share / a.tethers[i].share) - std::log(l.tethers[0].share / a.tethers[0].share);
    };
    double together = 0.0, apart = 0.0;  // the lean grows to one side
    for (std::size_t i = 0; i < a.tethers.size(); ++i) {
        const double s = (mesh.X(2, a.tethers[i].node) - mesh.X(2, a.tethers[0].node)) / stdev;
        EXPECT_NEAR(std::abs(log_ratio(b, i)), 0.5 * std::abs(s), 0.05) << "normals at the rim are not along x";
        together += log_ratio(b, i) * s;
        apart += std::abs(log_ratio(b, i) * s);
        EXPECT_NEAR(log_ratio(n, i), std::log(a.probability[i] / a.probability[0]), 1e-9);
    }
    EXPECT_GT(std::abs(together), 0.99 * apart);
    lean.num_groups = plain.num_groups = 4;
    EXPECT_EQ(make_ligament(mesh, c.ligament_prior, data, plain).group,
              make_ligament(mesh, c.ligament_prior, data, lean).group);
}

// A column of its own, by hand: theta h (g1 e + g2 e^2 + g3 e^3), e = d / h; the hold of the free layer is 0.1 % of it.
TEST(Ligament, ColumnPullsByTheCalibratedLaw) {
    Case c = block_with_prior();
    c.ligament_prior.resize(1);
    const TetMesh mesh = *TetMesh::make(c.mesh);
    constexpr double kHeight = 0.025, kTheta = 50.0;
    const LigamentData data{LigamentLaw::kCubicSpring, 1e5, 0.45, kHeight, 0.02, 0.0};
    LigamentSettings s;
    s.spring_law = {1.03, -1.20, 1.18};
    const Ligament ligament = make_ligament(mesh, c.ligament_prior, data, s);
    ASSERT_EQ(ligament.tethers.size(), 1u);
    const Tether& t = ligament.tethers[0];
    const Vector3d X = mesh.X.col(t.node), n = mesh.node_normal.col(t.node);
    for (const double e : {0.1, 0.3, 0.6}) {
        const double pull = evaluate(t, X - e * kHeight * n, kTheta).gradient.dot(-n);
        EXPECT_NEAR(pull, kTheta * kHeight * (1.03 * e - 1.20 * e * e + 1.18 * e * e * e), 4e-3 * pull) << e;
    }
}

TEST(Ligament, LawThatSoftensIsRefusedWithTheStrain) {
    EXPECT_TRUE(check_spring_law({1.03, -1.20, 1.18}));
    const Status refused = check_spring_law({1.0, -1.0, 0.0});  // slope 1 - 2 e
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().text.find("strain of 0.5"), std::string::npos) << refused.error().text;
    EXPECT_FALSE(check_spring_law({0.0, 6.0, 1.7}));
}

TEST(Ligament, QuantileInvertsTheNormalDistribution) {
    for (const double z : {-3.0, -1.0, 0.0, 0.5, 2.5})
        EXPECT_NEAR(normal_quantile(0.5 * std::erfc(-z / std::sqrt(2.0))), z, 1e-9);
}

}  // namespace
}  // namespace teres
