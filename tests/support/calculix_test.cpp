// The CalculiX helper itself against closed forms: it is the judge of our mechanics, so it is judged first.
#include "tests/support/calculix.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>

#include "tests/support/box_mesh.h"
#include "tests/support/test_data.h"

namespace teres::test {
namespace {

using Law = CalculixMaterial::Law;

/// A point where f changes sign, f(low) < 0 < f(high).
double root(const std::function<double(double)>& f, double low, double high) {
    for (int i = 0; i < 200; ++i) {
        const double mid = 0.5 * (low + high);
        (f(mid) < 0.0 ? low : high) = mid;
    }
    return 0.5 * (low + high);
}

struct Stretches {
    double axial, lateral;
};

/// S = lambda tr(E) I + 2 mu E, lateral S = 0: E_t = -nu E_a, P = stretch E_Y E_a.
Stretches stvk_under(double nominal_stress, double E, double nu) {
    const double axial = root([&](double l) { return l * E * 0.5 * (l * l - 1.0) - nominal_stress; }, 0.9, 3.0);
    return {axial, std::sqrt(1.0 - nu * (axial * axial - 1.0))};
}

/// Kirchhoff stress tau_i = 2G/alpha (l_i'^alpha - mean) + K J (J - 1); lateral tau = 0, axial tau = P l.
Stretches ogden_under(double nominal_stress, double G, double alpha, double K) {
    const auto tau = [&](double axial, double lateral, bool along) {
        const double J = axial * lateral * lateral, iso = std::pow(J, -alpha / 3.0);
        const double a = iso * std::pow(axial, alpha), t = iso * std::pow(lateral, alpha), mean = (a + 2.0 * t) / 3.0;
        return 2.0 * G / alpha * ((along ? a : t) - mean) + K * J * (J - 1.0);
    };
    const auto lateral_of = [&](double axial) {
        return root([&](double t) { return tau(axial, t, false); }, 0.3, 1.2);
    };
    const double axial = root([&](double l) { return tau(l, lateral_of(l), true) - nominal_stress * l; }, 0.9, 3.0);
    return {axial, lateral_of(axial)};
}

/// A block pulled along x with symmetry planes x = y = z = 0: a homogeneous state that every element holds
/// exactly.
CalculixProblem tension(const TetMeshData& mesh, const Point& size, double nominal_stress) {
    CalculixProblem problem;
    problem.nodes = mesh.nodes;
    problem.tets = mesh.tets;
    for (int axis = 0; axis < 3; ++axis) {
        for (const std::int32_t id : nodes_on_plane(mesh, axis, 0.0)) problem.rollers.push_back({id, axis});
    }
    for (const auto& face : faces_on_plane(mesh, 0, size[0])) {
        problem.face_tractions.push_back({face, {nominal_stress, 0.0, 0.0}});
    }
    problem.increments = 4;
    return problem;
}

void expect_homogeneous(const CalculixProblem& problem, const Stretches& truth) {
    const ScratchFolder scratch;
    const auto solution = solve_with_calculix(problem, scratch.path());
    ASSERT_TRUE(solution) << solution.error().text;
    double largest = 0.0, error = 0.0;
    for (std::size_t i = 0; i < problem.nodes.size(); ++i) {
        const Point exact{(truth.axial - 1.0) * problem.nodes[i][0], (truth.lateral - 1.0) * problem.nodes[i][1],
                          (truth.lateral - 1.0) * problem.nodes[i][2]};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            largest = std::max(largest, std::abs(exact[axis]));
            error = std::max(error, std::abs(solution->displacement_m[i][axis] - exact[axis]));
        }
    }
    EXPECT_GT(truth.axial, 1.05);      // a state far from linear
    EXPECT_LT(error, 2e-5 * largest);  // seven digits are printed; Newton stops at 1e-5
}

constexpr Point kBlock{0.04, 0.02, 0.03};

TEST(Calculix, TensionOfSaintVenantKirchhoffMatchesClosedForm) {
    TERES_REQUIRE_CALCULIX();
    const TetMeshData mesh = box_mesh(kBlock, 2, 1, 1);
    CalculixProblem problem = tension(mesh, kBlock, 4000.0);
    problem.material = {.law = Law::kLinear, .youngs_modulus_pa = 20000.0, .poissons_ratio = 0.3};
    expect_homogeneous(problem, stvk_under(4000.0, 20000.0, 0.3));
}

TEST(Calculix, TensionOfOgdenMatchesClosedForm) {
    TERES_REQUIRE_CALCULIX();
    const TetMeshData mesh = box_mesh(kBlock, 2, 1, 1);
    CalculixProblem problem = tension(mesh, kBlock, 4000.0);
    problem.material = {.law = Law::kOgden, .youngs_modulus_pa = 21485.8, .poissons_ratio = 0.49, .alpha = 0.88};
    expect_homogeneous(
        problem, ogden_under(4000.0, problem.material.shear_modulus_pa(), 0.88, problem.material.bulk_modulus_pa()));
}

TEST(Calculix, TensionOfNeoHookeanMatchesClosedForm) {
    TERES_REQUIRE_CALCULIX();
    const TetMeshData mesh = box_mesh(kBlock, 2, 1, 1);
    for (const bool quadratic : {true, false}) {
        CalculixProblem problem = tension(mesh, kBlock, 4000.0);
        problem.quadratic = quadratic;
        problem.material = {.law = Law::kNeoHookean, .youngs_modulus_pa = 20000.0, .poissons_ratio = 0.4};
        // The neo-Hookean law is Ogden's with alpha = 2.
        expect_homogeneous(
            problem, ogden_under(4000.0, problem.material.shear_modulus_pa(), 2.0, problem.material.bulk_modulus_pa()));
    }
}

// delta = P L^3 / (3 E I) + P L / (kappa G A), kappa = 5/6 at nu = 0 (where the clamp does not hinder the
// section).
TEST(Calculix, CantileverTipMatchesTimoshenko) {
    TERES_REQUIRE_CALCULIX();
    const Point size{0.1, 0.02, 0.02};
    const TetMeshData mesh = box_mesh(size, 15, 3, 3);
    CalculixProblem problem;
    problem.nodes = mesh.nodes;
    problem.tets = mesh.tets;
    problem.material = {.law = Law::kLinear, .youngs_modulus_pa = 1e6, .poissons_ratio = 0.0};
    problem.large_displacements = false;
    problem.clamped = nodes_on_plane(mesh, 0, 0.0);
    const double force = 0.1, height = size[2], section = size[1] * size[2];
    for (const auto& face : faces_on_plane(mesh, 0, size[0])) {
        problem.face_tractions.push_back({face, {0.0, 0.0, -force / section}});
    }
    const ScratchFolder scratch;
    const auto solution = solve_with_calculix(problem, scratch.path());
    ASSERT_TRUE(solution) << solution.error().text;
    const double inertia = size[1] * height * height * height / 12.0;
    const double truth =
        force * std::pow(size[0], 3) / (3.0 * 1e6 * inertia) + force * size[0] / (5.0 / 6.0 * 0.5e6 * section);
    double tip = 0.0;
    const auto tip_nodes = nodes_on_plane(mesh, 0, size[0]);
    for (const std::int32_t id : tip_nodes)
        tip -= solution->displacement_m[id][2] / static_cast<double>(tip_nodes.size());
    EXPECT_NEAR(tip, truth, 0.005 * truth);  // 3 quadratic elements over the height: well below 1 %
    EXPECT_NEAR(solution->reaction_n[2], force, 1e-5 * force);
}

// u(L) = rho g L^2 / (2 E) for a hanging column at nu = 0.
TEST(Calculix, HangingColumnMatchesClosedForm) {
    TERES_REQUIRE_CALCULIX();
    const Point size{0.02, 0.02, 0.1};
    const TetMeshData mesh = box_mesh(size, 1, 1, 4);
    CalculixProblem problem;
    problem.nodes = mesh.nodes;
    problem.tets = mesh.tets;
    problem.material = {.law = Law::kLinear, .youngs_modulus_pa = 1e5, .poissons_ratio = 0.0, .density_kg_m3 = 1060.0};
    problem.large_displacements = false;
    problem.clamped = nodes_on_plane(mesh, 2, size[2]);
    problem.gravity_m_s2 = {0.0, 0.0, -9.81};
    const ScratchFolder scratch;
    const auto solution = solve_with_calculix(problem, scratch.path());
    ASSERT_TRUE(solution) << solution.error().text;
    const double truth = 1060.0 * 9.81 * size[2] * size[2] / (2.0 * 1e5);
    for (const std::int32_t id : nodes_on_plane(mesh, 2, 0.0)) {
        EXPECT_NEAR(-solution->displacement_m[id][2], truth, 1e-5 * truth);
    }
}

TEST(Calculix, ReadsFortranNumbers) {
    const std::string dat =
        "\n displacements (vx,vy,vz) for set CORNERS and time  0.1000000E+01\n\n"
        "         1 -1.250000E-03  1.000000-101  0.000000E+00\n"
        "        12  4.500000E+00-7.0000000E-02 2.000000E+102\n";
    const auto rows = last_block(dat, "displacements");
    ASSERT_TRUE(rows) << rows.error().text;
    ASSERT_EQ(rows->size(), 2u);
    EXPECT_DOUBLE_EQ(rows->at(0)[0], -1.25e-3);
    EXPECT_DOUBLE_EQ(rows->at(0)[1], 1e-101);
    EXPECT_DOUBLE_EQ(rows->at(11)[1], -0.07);
    EXPECT_DOUBLE_EQ(rows->at(11)[2], 2e102);
    EXPECT_FALSE(last_block(dat, "forces"));
    EXPECT_FALSE(last_block("\n displacements x\n\n         1  ************************  0.0\n", "displacements"));
}

TEST(Calculix, ReportsItsOwnFailure) {
    TERES_REQUIRE_CALCULIX();
    const TetMeshData mesh = box_mesh(kBlock, 1, 1, 1);
    CalculixProblem problem = tension(mesh, kBlock, 100.0);
    problem.material = {.law = Law::kLinear, .youngs_modulus_pa = 20000.0, .poissons_ratio = 0.3};
    for (auto& tet : problem.tets) std::swap(tet[0], tet[1]);  // inside out
    const ScratchFolder scratch;
    const auto solution = solve_with_calculix(problem, scratch.path());
    ASSERT_FALSE(solution);
    EXPECT_EQ(solution.error().kind, ErrorKind::kNotUsable);
    EXPECT_THAT(solution.error().text, ::testing::HasSubstr("*ERROR"));
}

TEST(Calculix, RejectsBadProblems) {
    const TetMeshData mesh = box_mesh(kBlock, 1, 1, 1);
    CalculixProblem good = tension(mesh, kBlock, 100.0);
    good.material = {.law = Law::kLinear, .youngs_modulus_pa = 20000.0, .poissons_ratio = 0.3};
    ASSERT_TRUE(calculix_input(good));
    const auto rejected = [&](const auto& spoil, const std::string& says) {
        CalculixProblem bad = good;
        spoil(bad);
        const auto text = calculix_input(bad);
        ASSERT_FALSE(text) << says;
        EXPECT_EQ(text.error().kind, ErrorKind::kInvalidInput);
        EXPECT_THAT(text.error().text, ::testing::HasSubstr(says));
    };
    rejected([](auto& p) { p.tets[2][1] = 999; }, "tetrahedron 2");
    rejected([](auto& p) { p.rollers.clear(); }, "no node is held");
    rejected([](auto& p) { p.clamped = {-1}; }, "clamped node -1");
    rejected([](auto& p) { p.material.poissons_ratio = 0.5; }, "poissons_ratio = 0.5");
    rejected([](auto& p) { p.gravity_m_s2 = {0, 0, -9.81}; }, "density");
    rejected([](auto& p) { p.face_tractions[0].face = {0, 0, 0}; }, "not a face");
    rejected([](auto& p) { p.node_forces = {{77, {}}}; }, "loaded node 77");
}

}  // namespace
}  // namespace teres::test
