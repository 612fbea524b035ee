// A parted body: which faces of a block open, how far a beam split lengthwise opens (double cantilever, by hand), and
// whole recordings of a body that is parted half way.
#include "plugins/simulation/parted_body.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "plugins/simulation/trajectory.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::Vector3d;

Vector3d point(const Point& p) {
    return {p[0], p[1], p[2]};
}

double volume(const TetMeshData& mesh) {
    double sum = 0.0;
    for (const auto& t : mesh.tets) {
        const auto at = [&](std::size_t k) { return point(mesh.nodes[static_cast<std::size_t>(t[k])]); };
        sum += (at(1) - at(0)).cross(at(2) - at(0)).dot(at(3) - at(0)) / 6.0;
    }
    return sum;
}

// Squares of 10 mm, each halved along its diagonal: triangles' middles at a third and two thirds of it.
TEST(PartedBody, FacesWithinTheRadiusOpen) {
    const TetMeshData block = test::block_mesh({0.10, 0.04, 0.04}, {10, 4, 4});
    const Crack crack{{0.10, 0.02, 0.02}, Vector3d::UnitZ(), 0.035, 0.0};
    double expected = 0.0;
    for (int i = 0; i < 10; ++i)
        for (int j = 0; j < 4; ++j)
            for (const auto& [x, y] :
                 {std::pair(i + 1.0 / 3.0, j + 2.0 / 3.0), std::pair(i + 2.0 / 3.0, j + 1.0 / 3.0)})
                if (std::hypot(0.01 * x - 0.10, 0.01 * y - 0.02) <= 0.035) expected += 0.5e-4;
    const auto parted = part(block, crack);
    ASSERT_TRUE(parted);
    double opened = 0.0;
    for (const double area : parted->opened_m2) opened += area;
    EXPECT_NEAR(opened, expected, 1e-12);

    ASSERT_GT(parted->mesh.nodes.size(), block.nodes.size());
    EXPECT_NEAR(volume(parted->mesh), 0.10 * 0.04 * 0.04, 1e-15);
    std::set<std::int32_t> above, below;
    for (const auto& tet : parted->mesh.tets) {
        Vector3d middle = Vector3d::Zero();
        for (const auto node : tet) middle += 0.25 * point(parted->mesh.nodes[static_cast<std::size_t>(node)]);
        for (const auto node : tet) (middle.z() > 0.02 ? above : below).insert(node);
    }
    for (std::size_t i = 0; i < parted->mesh.nodes.size(); ++i) {
        EXPECT_EQ(parted->mesh.nodes[i], block.nodes[static_cast<std::size_t>(parted->origin[i])]);
        const Vector3d at = point(parted->mesh.nodes[i]);
        const bool amid = at.z() == 0.02 && (at - crack.centre_m).norm() < 0.02;
        const auto node = static_cast<std::int32_t>(i);
        EXPECT_FALSE(amid && above.contains(node) && below.contains(node)) << at.transpose();
    }
}

TEST(PartedBody, APlaneThatPartsNothingOrEverythingIsNone) {
    const TetMeshData block = test::block_mesh({0.10, 0.04, 0.04}, {10, 4, 4});
    EXPECT_FALSE(part(block, {{0.05, 0.02, 0.06}, Vector3d::UnitZ(), 0.01, 0.0}));
    EXPECT_FALSE(part(block, {{0.05, 0.02, 0.02}, Vector3d::UnitX(), 0.10, 0.0})) << "two pieces, one of them loose";
    EXPECT_TRUE(part(block, {{0.05, 0.02, 0.04}, Vector3d::UnitX(), 0.03, 0.0}));
}

// A beam of 120 x 20 x 40 mm, clamped at x = 0, split from x = 40 mm on: arms of a = 80, h = 20, b = 20 mm. A force F
// on the upper one opens their ends by
//
//     F (a + 0.64 h)^3 / (3 E I),   I = b h^3 / 12          0.64 h: the arms turn where they meet (plane stress, nu =
//     0)
constexpr double kForce = 2e-3, kYoung = 20e3;
const Crack kSplit{{0.12, 0.01, 0.02}, Vector3d::UnitZ(), 0.0805, 0.0};

Case split_beam() {
    Case c = test::clamped_block({.size_m = {0.12, 0.02, 0.04},
                                  .cells = {24, 4, 8},
                                  .law = BodyLaw::kStVK,
                                  .youngs_modulus_pa = kYoung,
                                  .poissons_ratio = 0.0,
                                  .frames = 6,
                                  .dt_s = 0.2,
                                  .quasi_static = true,
                                  .full_force_n = {0.0, 0.0, kForce}});
    LoadRegion& tip = c.load_regions.front();
    tip.node_ids.clear();
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        if (c.mesh.nodes[i][0] > 0.12 - 1e-9 && c.mesh.nodes[i][2] > 0.04 - 1e-9)
            tip.node_ids.push_back(static_cast<std::int32_t>(i));
    tip.weights.assign(tip.node_ids.size(), 1.0 / static_cast<double>(tip.node_ids.size()));
    c.markers = {{1, {0.12, 0.01, 0.04}}, {2, {0.12, 0.01, 0.0}}};
    c.observations.clear();
    return c;
}

TEST(PartedBody, ADoubleCantileverOpensAsByHand) {
    const Case c = split_beam();
    PlayerSettings settings;
    settings.model.equilibrium.relative_residual = 1e-7;
    const auto parted = PartedBody::make(c, settings, kSplit);
    ASSERT_NE(parted, nullptr);
    const auto whole = *Trajectory::make(c, settings);
    const std::vector<std::int32_t> last{5};
    std::vector<double> z(6);
    const TrajectoryReport report = parted->play({}, whole->effects(), last, {}, z, {}, {}, true);
    ASSERT_EQ(report.frames_converged, 1);
    const double I = 0.02 * std::pow(0.02, 3) / 12.0, a = 0.08 + 0.64 * 0.02;
    const double opening = kForce * std::pow(a, 3) / (3.0 * kYoung * I);
    EXPECT_NEAR((z[2] - z[5] - 0.04) / opening, 1.0, 0.1) << opening;
}

// Whole until the instant, parted from then on; whatever is asked of it.
TEST(PartedBody, ARecordingIsPartedFromAnInstantOn) {
    const Case c = split_beam();
    const PlayerSettings settings;
    const auto body = *Trajectory::make(c, settings);
    std::size_t cut = 0;
    while (std::string_view(body->effect(cut).id) != "cut") ++cut;
    std::vector<double> v(static_cast<std::size_t>(body->effect(cut).num_parameters));
    body->effect_candidate(cut, 0, v);
    const auto set = [&](std::string_view name, double value) {
        for (std::size_t p = 0; p < v.size(); ++p)
            if (name == body->effect_parameter(cut, p).name) v[p] = value;
    };
    set("center_x", kSplit.centre_m.x()), set("center_y", kSplit.centre_m.y()), set("center_z", kSplit.centre_m.z());
    set("radius", kSplit.radius_m), set("normal_z", 1.0), set("onset", 0.45), set("duration", 0.1);
    const std::vector<EffectInstance> on{{static_cast<std::int32_t>(cut), v}};

    constexpr std::size_t kRow = 6;
    std::vector<double> whole(6 * kRow), with(6 * kRow), again(6 * kRow), nodes(6 * 3 * body->num_nodes());
    ASSERT_EQ(body->simulate({}, whole, {}, {}).frames_converged, 6);
    const TrajectoryReport report = body->simulate({{}, on}, with, {}, nodes);
    EXPECT_EQ(report.frames_converged, report.frames);
    for (std::size_t k = 0; k < 3 * kRow; ++k) EXPECT_NEAR(with[k], whole[k], 1e-6) << "0, 0.2, 0.4 s";
    for (std::size_t f = 3; f < 6; ++f)
        EXPECT_GT(with[f * kRow + 2] - with[f * kRow + 5] - 0.04, 0.5e-3 * static_cast<double>(f) / 5.0) << f;

    const std::vector<std::int32_t> some{1, 3, 5};
    std::vector<double> at_some(3 * kRow);
    ASSERT_EQ(body->simulate_at({{}, on}, some, at_some).frames_converged, 3);
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t a = 0; a < kRow; ++a)
            EXPECT_NEAR(at_some[k * kRow + a], with[static_cast<std::size_t>(some[k]) * kRow + a], 1e-5);
    ASSERT_EQ(body->approximate({{}, on}, again).frames_converged, report.frames);
    for (std::size_t k = 0; k < again.size(); ++k) EXPECT_NEAR(again[k], with[k], 1e-5);

    std::vector<double> opened(body->num_nodes());
    ASSERT_TRUE(body->effect_forces(0, opened));
    Vector3d middle = Vector3d::Zero();
    double area = 0.0;
    for (std::size_t i = 0; i < opened.size(); ++i) middle += opened[i] * point(c.mesh.nodes[i]), area += opened[i];
    EXPECT_NEAR(area, 0.08 * 0.02, 1e-4);
    EXPECT_LT((middle / area - Vector3d(0.08, 0.01, 0.02)).norm(), 2e-3) << "the middle of what opened";

    std::vector<double> by_variant(2 * kRow);
    const std::vector<std::int32_t> before_and_after{1, 5};
    for (std::size_t k = 0; k < body->num_variants(); ++k)
        if (std::string_view(body->variant_name(k)) == "10-node tetrahedra") {
            ASSERT_EQ(body->simulate_variant(k, {{}, on}, before_and_after, by_variant, {}).frames_converged, 2);
            const double ours = with[5 * kRow + 2] - with[5 * kRow + 5],
                         theirs = by_variant[kRow + 2] - by_variant[kRow + 5];
            EXPECT_NEAR((theirs - 0.04) / (ours - 0.04), 1.0, 0.1);
        }
    std::vector<double> back(6 * kRow);
    ASSERT_EQ(body->simulate({}, back, {}, {}).frames_converged, 6);
    for (std::size_t k = 0; k < back.size(); ++k) EXPECT_NEAR(back[k], whole[k], 1e-6) << "nothing stays parted";
}

}  // namespace
}  // namespace teres
