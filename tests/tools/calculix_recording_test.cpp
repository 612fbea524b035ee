// Recordings by CalculiX against closed forms and against our own simulation.
#include "tools/calculix/recording.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "tests/support/calculix.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"
#include "tools/blindtest/truth_mesh.h"
#include "tools/score.h"

namespace teres::test {
namespace {

using blindtest::TruthMesh;

std::vector<std::int32_t> nodes_at(const std::vector<Point>& nodes, std::size_t axis, double value) {
    std::vector<std::int32_t> ids;
    for (std::size_t i = 0; i < nodes.size(); ++i)
        if (std::abs(nodes[i][axis] - value) < 1e-9) ids.push_back(static_cast<std::int32_t>(i));
    return ids;
}

// A cube with a Maxwell branch beside it, pulled at once and held: creep of the standard linear solid,
// e(t) = s/(3 G) [1 - r/(1+r) exp(-t / (tau (1+r)))], r = G_branch / G; the cube is nearly incompressible.
TEST(CalculixRecording, MaxwellBranchCreepsAsTheStandardLinearSolid) {
    TERES_REQUIRE_CALCULIX();
    const double side = 0.01, stress = 40.0, tau = 1.5, r = 0.8;
    const TruthMesh mesh(block_mesh({side, side, side}, {1, 1, 1}));
    CalculixRecording recording;
    recording.nodes = mesh.nodes();
    CalculixMaterial body{
        .law = CalculixMaterial::Law::kNeoHookean, .youngs_modulus_pa = 9000.0, .poissons_ratio = 0.49};
    CalculixMaterial branch{.law = CalculixMaterial::Law::kLinear,
                            .youngs_modulus_pa = 2.0 * 1.3 * r * body.shear_modulus_pa(),
                            .poissons_ratio = 0.3};
    branch.creep_per_pa_s = 1.0 / (3.0 * branch.shear_modulus_pa() * tau);
    recording.parts = {{Part::Element::kTet10, mesh.tets10(), body}, {Part::Element::kTet10, mesh.tets10(), branch}};
    for (int axis = 0; axis < 3; ++axis)
        recording.supports.push_back({nodes_at(mesh.nodes(), static_cast<std::size_t>(axis), 0.0), axis, {}});
    NodalLoad pull{{}, {{0.0, 0.01, 10.0}, {0.0, 1.0, 1.0}}};
    for (std::size_t t = 0; t < mesh.surface().triangles().size(); ++t) {
        if (std::abs(mesh.centroid(t)[0] - side) > 1e-9) continue;
        const auto face = mesh.face_nodes(t);
        for (std::size_t i = 3; i < 6; ++i) pull.pattern.push_back({face[i], {stress * mesh.area(t) / 3.0, 0.0, 0.0}});
    }
    recording.loads = {pull};
    recording.times_s = {0.01, 1.0, 3.0, 8.0};
    recording.max_increment_s = 0.1;
    recording.residual = 1e-4;
    recording.correction = 1e-3;
    const std::int32_t corner = nodes_at(mesh.nodes(), 0, side).front();
    recording.output_nodes = {corner};
    const ScratchFolder scratch;
    const auto solution = solve_recording(recording, scratch.path(), 60.0);
    ASSERT_TRUE(solution) << solution.error().text;
    for (std::size_t k = 0; k < recording.times_s.size(); ++k) {
        const double t = recording.times_s[k];
        const double strain =
            stress / (3.0 * body.shear_modulus_pa()) * (1.0 - r / (1.0 + r) * std::exp(-t / (tau * (1.0 + r))));
        EXPECT_NEAR(solution->displacement_m[k].at(corner)[0] / side, strain, 0.04 * strain) << "t = " << t;
    }
}

// A wedge layer of the body's own material on a block is just a longer block: u = s L / E at its end.
TEST(CalculixRecording, WedgesContinueTheTetrahedra) {
    TERES_REQUIRE_CALCULIX();
    const double side = 0.01, height = 0.005;
    TruthMesh mesh(block_mesh({side, side, side}, {1, 1, 1}));
    std::vector<std::int32_t> top;
    for (std::size_t t = 0; t < mesh.surface().triangles().size(); ++t)
        if (std::abs(mesh.centroid(t)[2] - side) < 1e-9) top.push_back(static_cast<std::int32_t>(t));
    const blindtest::WedgeLayer layer = mesh.extrude(top, height, 1);
    EXPECT_EQ(layer.wedges.size(), top.size());
    // The extrusion follows node normals, which lean outwards at the block's edges: set upright, mid-edge nodes in the
    // middle.
    std::vector<Point> nodes = mesh.nodes();
    const double end = side + height;
    const auto at = [&](std::int32_t id) -> Point& { return nodes[static_cast<std::size_t>(id)]; };
    for (const auto& w : layer.wedges)
        for (std::size_t i = 0; i < 3; ++i) at(w[3 + i]) = {at(w[i])[0], at(w[i])[1], end};
    for (const auto& w : layer.wedges)
        for (std::size_t i = 0; i < 3; ++i) {
            at(w[9 + i]) = times(0.5, plus(at(w[3 + i]), at(w[3 + (i + 1) % 3])));
            at(w[12 + i]) = times(0.5, plus(at(w[i]), at(w[3 + i])));
        }

    CalculixMaterial material{
        .law = CalculixMaterial::Law::kNeoHookean, .youngs_modulus_pa = 10e3, .poissons_ratio = 0.3};
    CalculixRecording recording;
    recording.nodes = nodes;
    recording.parts = {{Part::Element::kTet10, mesh.tets10(), material},
                       {Part::Element::kWedge15, layer.wedges, material}};
    for (int axis = 0; axis < 3; ++axis)
        recording.supports.push_back({nodes_at(nodes, static_cast<std::size_t>(axis), 0.0), axis, {}});
    recording.supports.push_back({layer.far_nodes, 2, Curve{{0.0, 1.0}, {0.0, 0.01 * end}}});
    recording.times_s = {1.0};
    recording.output_nodes = nodes_at(nodes, 2, side);
    recording.residual = 1e-5;
    recording.correction = 1e-4;
    const ScratchFolder scratch;
    const auto solution = solve_recording(recording, scratch.path(), 60.0);
    ASSERT_TRUE(solution) << solution.error().text;
    for (const auto& [node, u] : solution->displacement_m[0]) EXPECT_NEAR(u[2], 0.01 * side, 2e-3 * 0.01 * side);
}

// A block all but rigid, drawn against strings whose table begins with no force at all: n k (e + slack) = P.
TEST(CalculixRecording, StringsMayBeginWithoutForce) {
    TERES_REQUIRE_CALCULIX();
    const double side = 0.01, k = 20.0, ahead = 0.001;
    const TruthMesh mesh(block_mesh({side, side, side}, {1, 1, 1}));
    CalculixRecording recording;
    recording.nodes = mesh.nodes();
    const CalculixMaterial body{
        .law = CalculixMaterial::Law::kNeoHookean, .youngs_modulus_pa = 1e6, .poissons_ratio = 0.3};
    recording.parts = {{Part::Element::kTet10, mesh.tets10(), body}};
    for (const int axis : {1, 2})
        recording.supports.push_back({nodes_at(mesh.nodes(), static_cast<std::size_t>(axis), 0.0), axis, {}});
    const auto back = nodes_at(mesh.nodes(), 0, 0.0), front = nodes_at(mesh.nodes(), 0, side);
    for (const std::int32_t node : back) {
        Point anchor = mesh.nodes()[static_cast<std::size_t>(node)];
        anchor[0] -= 0.05;
        recording.line_springs.push_back({node, anchor, {{-0.1, 0.0}, {-ahead, 0.0}, {0.1, k * (0.1 + ahead)}}});
    }
    const auto strings = static_cast<double>(back.size());
    const double pull_n = 2.0 * ahead * strings * k;
    NodalLoad pull{{}, {{0.0, 0.5, 10.0}, {0.5, 1.0, 1.0}}};
    for (const std::int32_t node : front)
        pull.pattern.push_back({node, {pull_n / static_cast<double>(front.size()), 0.0, 0.0}});
    recording.loads = {pull};
    recording.times_s = {1.0};
    recording.max_increment_s = 0.1;
    recording.residual = 1e-4;
    recording.correction = 1e-3;
    recording.output_nodes = {back.front()};
    const ScratchFolder scratch;
    const auto solution = solve_recording(recording, scratch.path(), 60.0);
    ASSERT_TRUE(solution) << solution.error().text;
    EXPECT_NEAR(solution->displacement_m[0].at(back.front())[0], pull_n / (strings * k) - ahead, 0.05 * ahead);
}

// The same clamped block under the same growing load: ten-node elements by CalculiX, a finer mesh by `teres simulate`.
TEST(CalculixRecording, ControlAgreesWithOurOwnSimulation) {
    TERES_REQUIRE_CALCULIX();
    BlockOptions options;
    options.cells = {18, 6, 6};
    options.law = BodyLaw::kNeoHookean;
    options.frames = 3;
    options.full_force_n = {0.0, 0.0, -0.04};
    const Case c = clamped_block(options);
    const ScratchFolder scratch;
    ASSERT_TRUE(write_case(c, scratch.path() / "case"));
    const std::string predicted = (scratch.path() / "points.csv").string();
    const test::Run run = run_teres({"simulate", (scratch.path() / "case").string(), "--predict", predicted});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const auto ours = read_positions(predicted, "point_id");
    ASSERT_TRUE(ours) << ours.error().text;

    const TruthMesh mesh(block_mesh(options.size_m, {7, 2, 2}));
    CalculixRecording recording;
    recording.nodes = mesh.nodes();
    recording.parts = {{Part::Element::kTet10,
                        mesh.tets10(),
                        {.law = CalculixMaterial::Law::kNeoHookean,
                         .youngs_modulus_pa = c.body.youngs_modulus_pa,
                         .poissons_ratio = c.body.poissons_ratio}}};
    for (int axis = 0; axis < 3; ++axis) recording.supports.push_back({nodes_at(mesh.nodes(), 0, 0.0), axis, {}});
    NodalLoad load{{}, {{0.0, 2.0}, {0.0, 1.0}}};
    const double far_area = options.size_m[1] * options.size_m[2];
    std::map<std::int32_t, Point> pattern;
    for (std::size_t t = 0; t < mesh.surface().triangles().size(); ++t) {
        if (std::abs(mesh.centroid(t)[0] - options.size_m[0]) > 1e-9) continue;
        const auto face = mesh.face_nodes(t);
        for (std::size_t i = 3; i < 6; ++i)
            pattern[face[i]] = plus(pattern[face[i]], times(mesh.area(t) / 3.0 / far_area, options.full_force_n));
    }
    load.pattern.assign(pattern.begin(), pattern.end());
    recording.loads = {load};
    recording.times_s = {1.0, 2.0};
    recording.max_increment_s = 1.0;
    for (std::size_t i = 0; i < mesh.nodes().size(); ++i)
        recording.output_nodes.push_back(static_cast<std::int32_t>(i));
    const auto solution = solve_recording(recording, scratch.path() / "ccx", 120.0);
    ASSERT_TRUE(solution) << solution.error().text;

    std::vector<PositionSample> truth;
    double largest = 0.0;
    for (std::size_t k = 0; k < 3; ++k)
        for (const MarkerRest& point : c.validation_rest) {
            Point u{};
            if (k > 0)
                for (const auto& [node, weight] : blindtest::in_body(mesh, point.position_m).weights)
                    u = plus(u, times(weight, solution->displacement_m[k - 1].at(node)));
            truth.push_back({static_cast<double>(k) * c.dt_s, point.id, plus(point.position_m, u)});
            largest = std::max(largest, norm(u));
        }
    const auto score = tools::score_prediction(truth, *ours);
    ASSERT_TRUE(score) << score.error().text;
    EXPECT_EQ(score->num_missing, 0u);
    EXPECT_GT(largest, 0.005);
    EXPECT_LT(1e-3 * score->max_mm, 0.06 * largest);  // linear elements against ten-node ones
}

}  // namespace
}  // namespace teres::test
