// Our quasi-static mechanics against CalculiX 2.20: first the same elements on both sides (one answer, two
// programs), then our default linear tetrahedra against ten-node ones. Prints the table of VALIDATION.md,
// "Mechanics against CalculiX".
#include "tests/support/calculix.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include "plugins/simulation/case_model.h"
#include "tests/support/box_mesh.h"
#include "tests/support/test_data.h"

namespace teres::test {
namespace {

/// A box clamped at `clamp_axis` = 0, with a uniform dead traction on some faces.
struct Scene {
    TetMeshData mesh;
    BodyData body;
    std::vector<std::int32_t> clamped;
    std::vector<std::array<std::int32_t, 3>> faces;
    Point traction_pa{};
    int increments = 1;
};

double face_area(const TetMeshData& mesh, const std::array<std::int32_t, 3>& face) {
    const Eigen::Vector3d a(mesh.nodes[face[0]].data()), b(mesh.nodes[face[1]].data()), c(mesh.nodes[face[2]].data());
    return 0.5 * (b - a).cross(c - a).norm();
}

/// Consistent nodal forces of linear faces, as weights that sum to 1, and the loaded area.
std::map<std::int32_t, double> load_weights(const Scene& scene, double& area) {
    std::map<std::int32_t, double> weights;
    area = 0.0;
    for (const auto& face : scene.faces) area += face_area(scene.mesh, face);
    for (const auto& face : scene.faces) {
        for (const std::int32_t node : face) weights[node] += face_area(scene.mesh, face) / (3.0 * area);
    }
    return weights;
}

/// The same for quadratic faces: a third of each face's force on each of its mid-edge nodes, none on corners.
std::map<std::int32_t, double> mid_edge_weights(const Scene& scene, const TetMeshData& data, double area) {
    const auto mesh = TetMesh::make(data);
    const QuadraticMesh quadratic = make_quadratic(*mesh);
    std::map<std::array<NodeIndex, 2>, NodeIndex> mid;
    for (std::size_t i = 0; i < quadratic.edge.size(); ++i)
        mid[quadratic.edge[i]] = static_cast<NodeIndex>(data.nodes.size() + i);
    std::map<std::int32_t, double> weights;
    for (const auto& face : scene.faces) {
        for (std::size_t i = 0; i < 3; ++i) {
            const auto [a, b] = std::minmax(face[i], face[(i + 1) % 3]);
            weights[mid.at({a, b})] += face_area(data, face) / (3.0 * area);
        }
    }
    return weights;
}

/// Our equilibrium at full load: displacements of the corner nodes. Fails the test if a step does not
/// converge.
std::vector<Point> solve_ours(const Scene& scene, ElementType element) {
    Case c;
    c.mesh = scene.mesh;
    c.body = scene.body;
    c.clamped = scene.clamped;
    double area = 0.0;
    LoadRegion region{"load", {}, {}};
    const auto corners = load_weights(scene, area);
    for (const auto& [node, weight] :
         element == ElementType::kQuadratic ? mid_edge_weights(scene, c.mesh, area) : corners) {
        region.node_ids.push_back(node);
        region.weights.push_back(weight);
    }
    c.load_regions = {region};
    CaseModelSettings settings;
    settings.element = element;
    settings.equilibrium.relative_residual = 1e-8;
    settings.max_lanes = 1;
    auto model = CaseModel::make(c, settings);
    std::vector<Point> displacement(scene.mesh.nodes.size());
    if (!model) {
        ADD_FAILURE() << model.error().text;
        return displacement;
    }
    std::vector<double> x((*model)->num_state());
    (*model)->rest_state(x);
    const std::vector<double> rest = x;
    for (int step = 1; step <= scene.increments; ++step) {
        std::array<double, 3> force{};
        for (std::size_t i = 0; i < 3; ++i) force[i] = scene.traction_pa[i] * area * step / scene.increments;
        ForwardInputs inputs;
        inputs.region_force_n = force;
        const ForwardReport report = (*model)->advance(inputs, {}, x, 1);
        EXPECT_EQ(report.lanes_converged, 1) << "step " << step << ", residual " << report.relative_residual;
    }
    for (std::size_t i = 0; i < displacement.size(); ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) displacement[i][axis] = x[3 * i + axis] - rest[3 * i + axis];
    }
    return displacement;
}

std::vector<Point> solve_calculix(const Scene& scene, bool quadratic) {
    CalculixProblem problem;
    problem.nodes = scene.mesh.nodes;
    problem.tets = scene.mesh.tets;
    problem.clamped = scene.clamped;
    problem.quadratic = quadratic;
    problem.increments = scene.increments;
    // The larger ones stop at 1e-3 of the increment, as far below the figures in the table as they need.
    if (scene.mesh.tets.size() > 1000) {
        problem.residual = 1e-4;
        problem.correction = 1e-3;
    }
    problem.material.law =
        scene.body.law == BodyLaw::kOgden ? CalculixMaterial::Law::kOgden : CalculixMaterial::Law::kLinear;
    problem.material.youngs_modulus_pa = scene.body.youngs_modulus_pa;
    problem.material.poissons_ratio = scene.body.poissons_ratio;
    problem.material.alpha = scene.body.alpha;
    for (const auto& face : scene.faces) problem.face_tractions.push_back({face, scene.traction_pa});
    const ScratchFolder scratch;
    const auto solution = solve_with_calculix(problem, scratch.path());
    if (!solution) {
        ADD_FAILURE() << solution.error().text;
        return std::vector<Point>(scene.mesh.nodes.size());
    }
    std::printf("CalculiX %s: %zu tetrahedra, %zu nodes, %.1f s\n", quadratic ? "C3D10" : "C3D4", problem.tets.size(),
                solution->num_nodes, solution->seconds);
    return solution->displacement_m;
}

struct Difference {
    double relative = 0.0;    ///< |u - u_ref| / |u_ref| over the nodes that both meshes have (Euclidean norms)
    double load_ratio = 0.0;  ///< displacement of the loaded face along the load over that of the reference
    double loaded_mm = 0.0;   ///< displacement of the reference's loaded face along the load
};

std::array<long, 3> key(const Point& p) {
    return {std::lround(p[0] * 1e7), std::lround(p[1] * 1e7), std::lround(p[2] * 1e7)};
}

Difference compare(const Scene& ours, const std::vector<Point>& u, const Scene& reference,
                   const std::vector<Point>& u_ref) {
    std::map<std::array<long, 3>, std::size_t> at;
    for (std::size_t i = 0; i < reference.mesh.nodes.size(); ++i) at[key(reference.mesh.nodes[i])] = i;
    double error = 0.0, norm = 0.0;
    std::size_t common = 0;
    for (std::size_t i = 0; i < u.size(); ++i) {
        const auto found = at.find(key(ours.mesh.nodes[i]));
        if (found == at.end()) continue;
        ++common;
        const Eigen::Vector3d a(u[i].data()), b(u_ref[found->second].data());
        error += (a - b).squaredNorm();
        norm += b.squaredNorm();
    }
    EXPECT_GT(common, 20u);
    const auto along = [](const Scene& scene, const std::vector<Point>& v) {
        double area = 0.0, sum = 0.0;
        for (const auto& [node, weight] : load_weights(scene, area)) {
            sum += weight * Eigen::Vector3d(v[node].data()).dot(Eigen::Vector3d(scene.traction_pa.data()));
        }
        return sum / Eigen::Vector3d(scene.traction_pa.data()).norm();
    };
    return {std::sqrt(error / norm), along(ours, u) / along(reference, u_ref), 1e3 * along(reference, u_ref)};
}

const char* name(ElementType element) {
    switch (element) {
        case ElementType::kLinear:
            return "linear (plain)";
        case ElementType::kNodalVolume:
            return "nodal_volume";
        case ElementType::kNodalBlend:
            return "nodal_blend";
        case ElementType::kQuadratic:
            return "quadratic";
    }
    return "";
}

Difference report(const char* scene_name, const Scene& scene, ElementType element, const Scene& reference,
                  const std::vector<Point>& u_ref) {
    const Difference d = compare(scene, solve_ours(scene, element), reference, u_ref);
    std::printf("| %s | %s | %zu | %.1f | %.4f | %.2f %% |\n", scene_name, name(element), scene.mesh.tets.size(),
                d.loaded_mm, d.load_ratio, 100.0 * d.relative);
    return d;
}

BodyData stvk() {
    BodyData body;
    body.law = BodyLaw::kStVK;
    body.youngs_modulus_pa = 20000.0;
    body.poissons_ratio = 0.3;
    return body;
}

BodyData liver_ogden() {  // G = 7.21 kPa, alpha = 0.88, nu = 0.49
    BodyData body;
    body.law = BodyLaw::kOgden;
    body.shear_modulus_pa = 7210.0;
    body.alpha = 0.88;
    body.poissons_ratio = 0.49;
    body.youngs_modulus_pa = 2.0 * 7210.0 * 1.49;
    body.bulk_modulus_pa = body.youngs_modulus_pa / (3.0 * (1.0 - 2.0 * 0.49));
    return body;
}

/// 100 x 20 x 20 mm, clamped at x = 0, end face pushed down by `n` bricks over the height: the tip sinks by a
/// third of the length.
Scene cantilever(int n) {
    Scene scene;
    const Point size{0.1, 0.02, 0.02};
    scene.mesh = box_mesh(size, 5 * n, n, n);
    scene.body = stvk();
    scene.clamped = nodes_on_plane(scene.mesh, 0, 0.0);
    scene.faces = faces_on_plane(scene.mesh, 0, size[0]);
    scene.traction_pa = {0.0, 0.0, -80.0};
    scene.increments = 4;
    return scene;
}

/// 40 x 40 x 60 mm of liver, clamped at z = 0, sheared and bent by a traction along x and pulled along z on
/// top.
Scene clamped_block(int n) {
    Scene scene;
    const Point size{0.04, 0.04, 0.06};
    scene.mesh = box_mesh(size, 2 * n, 2 * n, 3 * n);
    scene.body = liver_ogden();
    scene.clamped = nodes_on_plane(scene.mesh, 2, 0.0);
    scene.faces = faces_on_plane(scene.mesh, 2, size[2]);
    scene.traction_pa = {700.0, 0.0, 500.0};
    scene.increments = 2;
    return scene;
}

/// 90 x 90 x 67.5 mm of liver on a rigid base, pressed on a square of 22.5 mm off the middle: volume is what
/// resists.
Scene pressed_block(int n) {
    Scene scene;
    const Point size{0.09, 0.09, 0.0675};
    scene.mesh = box_mesh(size, 4 * n, 4 * n, 3 * n);
    scene.body = liver_ogden();
    scene.clamped = nodes_on_plane(scene.mesh, 2, 0.0);
    const double low = 0.25 * size[0] - 1e-9, high = 0.5 * size[0] + 1e-9;
    for (const auto& face : faces_on_plane(scene.mesh, 2, size[2])) {
        bool inside = true;
        for (const std::int32_t node : face) {
            const Point& p = scene.mesh.nodes[node];
            inside = inside && p[0] > low && p[0] < high && p[1] > low && p[1] < high;
        }
        if (inside) scene.faces.push_back(face);
    }
    scene.traction_pa = {0.0, 0.0, -4000.0};
    scene.increments = 1;
    return scene;
}

// One discrete problem, two programs: seven digits are printed, Newton of ccx stops at 1e-5 of the increment.
TEST(Mechanics, EqualsCalculixOnTheSameElements) {
    TERES_REQUIRE_CALCULIX();
    const Scene scene = cantilever(2);
    for (const ElementType element : {ElementType::kLinear, ElementType::kQuadratic}) {
        const auto u_ref = solve_calculix(scene, element == ElementType::kQuadratic);
        const Difference d = report("cantilever, same elements", scene, element, scene, u_ref);
        EXPECT_GT(d.loaded_mm, 10.0);  // far from linear
        EXPECT_LT(d.relative, 2e-5);
    }
}

// CalculiX has K/2 (J - 1)^2 where we have K/2 ln(J)^2: at nu = 0.49 J stays within 1 % of 1.
TEST(Mechanics, EqualsCalculixOnTheSameElementsForOgden) {
    TERES_REQUIRE_CALCULIX();
    const Scene scene = clamped_block(2);
    for (const ElementType element : {ElementType::kLinear, ElementType::kQuadratic}) {
        const auto u_ref = solve_calculix(scene, element == ElementType::kQuadratic);
        const Difference d = report("clamped block, same elements", scene, element, scene, u_ref);
        EXPECT_GT(d.loaded_mm, 5.0);
        EXPECT_LT(d.relative, 1e-3);
    }
}

TEST(Mechanics, CantileverConvergesToCalculix) {
    TERES_REQUIRE_CALCULIX();
    const Scene reference = cantilever(4);
    const auto u_ref = solve_calculix(reference, true);
    const auto row = [&](int n, ElementType element) {
        return report("cantilever, StVK nu 0.3", cantilever(n), element, reference, u_ref);
    };
    EXPECT_LT(row(2, ElementType::kQuadratic).relative, 0.01);  // the reference itself no longer moves
    double before = 1.0;
    for (const int n : {2, 4, 8}) {
        const Difference plain = row(n, ElementType::kLinear), blend = row(n, ElementType::kNodalBlend);
        EXPECT_LT(blend.relative, 0.5 * before);  // at least first order
        EXPECT_LT(blend.relative, 0.5 * plain.relative);
        before = blend.relative;
    }
    EXPECT_LT(before, 0.015);
}

TEST(Mechanics, ClampedOgdenBlockConvergesToCalculix) {
    TERES_REQUIRE_CALCULIX();
    const Scene reference = clamped_block(3);
    const auto u_ref = solve_calculix(reference, true);
    const auto row = [&](int n, ElementType element) {
        return report("clamped block, Ogden nu 0.49", clamped_block(n), element, reference, u_ref);
    };
    EXPECT_LT(row(2, ElementType::kQuadratic).relative, 0.03);  // how far the reference still moves
    double before = 1.0;
    for (const int n : {1, 2, 3}) {
        const Difference plain = row(n, ElementType::kLinear), blend = row(n, ElementType::kNodalBlend);
        EXPECT_LT(blend.relative, 0.6 * before);
        EXPECT_LT(blend.relative, 0.55 * plain.relative);
        before = blend.relative;
    }
    EXPECT_LT(before, 0.06);
}

TEST(Mechanics, PressedBlockOfEightThousandTetrahedraDoesNotLock) {
    TERES_REQUIRE_CALCULIX();
    const Scene reference = pressed_block(3);
    const auto u_ref = solve_calculix(reference, true);
    const auto row = [&](int n, ElementType element) {
        return report("pressed block, Ogden nu 0.49", pressed_block(n), element, reference, u_ref);
    };
    EXPECT_LT(row(2, ElementType::kQuadratic).relative, 0.04);
    for (const int n : {1, 2}) {
        for (const ElementType element : {ElementType::kLinear, ElementType::kNodalVolume, ElementType::kNodalBlend}) {
            row(n, element);
        }
    }
    const Difference plain = row(3, ElementType::kLinear), volume = row(3, ElementType::kNodalVolume),
                     blend = row(3, ElementType::kNodalBlend);
    EXPECT_LT(plain.load_ratio, 0.8);  // what locking costs on the same mesh
    EXPECT_GT(volume.load_ratio, 0.9);
    EXPECT_NEAR(blend.load_ratio, 1.0, 0.03);
    EXPECT_LT(blend.relative, 0.05);
}

}  // namespace
}  // namespace teres::test
