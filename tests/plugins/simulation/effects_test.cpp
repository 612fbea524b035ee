// Effects against independent truth: CalculiX where it has the same effect, closed form otherwise.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <numbers>

#include "plugins/simulation/effects/places.h"
#include "plugins/simulation/scene_player.h"
#include "plugins/simulation/trajectory.h"
#include "tests/support/box_mesh.h"
#include "tests/support/calculix.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using Eigen::Vector3d;

const Point kSize{0.08, 0.03, 0.03};
constexpr double kE = 12e3, kNu = 0.40, kDensity = 1050.0;

// A block clamped at x = 0, markers on its top, points on nodes of the free end.
Case block(int nx = 8, int ny = 3, int nz = 3, double nu = kNu, BodyLaw law = BodyLaw::kStVK) {
    Case c;
    c.name = "block";
    c.num_frames = 1;
    c.dt_s = 0.2;
    c.quasi_static = true;
    c.body.law = law;
    c.body.youngs_modulus_pa = kE;
    c.body.poissons_ratio = nu;
    c.body.density_kg_m3 = kDensity;
    c.mesh = test::box_mesh(kSize, nx, ny, nz);
    c.clamped = test::nodes_on_plane(c.mesh, 0, 0.0);
    c.markers.push_back({0, {0.9 * kSize[0], 0.5 * kSize[1], kSize[2]}});
    return c;
}

std::size_t index_of(const Trajectory& t, const std::string& id) {
    for (std::size_t e = 0; e < t.num_effects(); ++e)
        if (t.effect(e).id == id) return e;
    ADD_FAILURE() << id << " is not in the catalogue";
    return 0;
}

using Values = std::vector<std::pair<std::string, double>>;

std::vector<double> values_of(const Trajectory& t, std::size_t effect, const Values& given) {
    std::vector<double> values;
    for (std::int32_t p = 0; p < t.effect(effect).num_parameters; ++p) {
        const EffectParameter parameter = t.effect_parameter(effect, std::size_t(p));
        double v = parameter.role == EffectRole::kAmplitude       ? parameter.null_value
                   : parameter.transform == EffectTransform::kLog ? std::exp(parameter.prior_mean)
                                                                  : parameter.prior_mean;
        for (const auto& [name, value] : given)
            if (name == parameter.name) v = value;
        values.push_back(v);
    }
    return values;
}

// Node positions of all frames under one effect.
std::vector<double> nodes_under(const Case& c, const std::string& id, const Values& given,
                                ElementType element = ElementType::kQuadratic, std::vector<double> theta = {}) {
    PlayerSettings settings;
    settings.model.element = element;
    settings.soft_clamps = element != ElementType::kQuadratic;  // the layer has no mid-edge nodes
    settings.model.equilibrium.relative_residual = 1e-5;
    settings.model.ligament.num_groups = 1;
    auto t = *Trajectory::make(c, settings);
    std::vector<double> x(t->num_frames() * 3 * t->num_nodes());
    const std::size_t e = index_of(*t, id);
    const std::vector<double> values = values_of(*t, e, given);
    const std::vector<EffectInstance> on{{std::int32_t(e), values}};
    const TrajectoryReport r = t->simulate({theta, on}, {}, {}, x);
    EXPECT_EQ(r.frames_converged, r.frames) << id << ": residual " << r.relative_residual;
    return x;
}

test::CalculixProblem same_in_calculix(const Case& c) {
    test::CalculixProblem p;
    p.nodes = c.mesh.nodes;
    p.tets = c.mesh.tets;
    p.material.youngs_modulus_pa = c.body.youngs_modulus_pa;
    p.material.poissons_ratio = c.body.poissons_ratio;
    p.material.density_kg_m3 = kDensity;
    p.clamped = c.clamped;
    p.increments = 2;
    p.threads = 1;
    return p;
}

// Relative difference of the displacements of all corner nodes (x of the last frame).
double difference(const Case& c, const std::vector<double>& x, const std::vector<Point>& displacement) {
    const std::size_t N = c.mesh.nodes.size(), last = x.size() - 3 * N;
    double error = 0.0, size = 0.0;
    for (std::size_t i = 0; i < N; ++i)
        for (std::size_t a = 0; a < 3; ++a) {
            error += std::pow(x[last + 3 * i + a] - c.mesh.nodes[i][a] - displacement[i][a], 2);
            size += std::pow(displacement[i][a], 2);
        }
    EXPECT_GT(std::sqrt(size / double(N)), 2e-4);
    return std::sqrt(error / size);
}

// Body force: same elements, same law; what differs is the clamp's thin layer and the mid-edge nodes on it.
TEST(Effects, GravityBendsTheBlockAsInCalculix) {
    TERES_REQUIRE_CALCULIX();
    const Case c = block();
    auto p = same_in_calculix(c);
    p.gravity_m_s2 = {0.3, -0.8, -2.0};
    const test::ScratchFolder scratch;
    const auto truth = test::solve_with_calculix(p, scratch.path());
    ASSERT_TRUE(truth) << truth.error().text;
    const auto x = nodes_under(c, "gravity", {{"change_x", 0.3}, {"change_y", -0.8}, {"change_z", -2.0}});
    EXPECT_LT(difference(c, x, truth->displacement_m), 0.03);
}

// What lifts a body by more than it weighs is another load.
TEST(Effects, AWeightIsMissingOrTiltedNotReversed) {
    const auto t = *Trajectory::make(block(), {});
    std::size_t e = 0;
    while (e < t->num_effects() && std::string_view(t->effect(e).id) != "gravity") ++e;
    ASSERT_LT(e, t->num_effects());
    for (std::size_t p = 0; p < 3; ++p) {
        EXPECT_DOUBLE_EQ(t->effect_parameter(e, p).upper, 9.80665);
        EXPECT_DOUBLE_EQ(t->effect_parameter(e, p).lower, -9.80665);
    }
}

// Slower than one turn in five sixths of the recording it could follow any drift, and so it could at more than ten
// seconds a turn.
TEST(Effects, WhatBreathesComesBackWithinTheRecording) {
    const PlayerSettings settings;
    const auto slowest_hz = [&](int frames, double dt_s) {
        const Case c = test::clamped_block({.cells = {4, 2, 2}, .frames = frames, .dt_s = dt_s, .quasi_static = true});
        const auto t = *Trajectory::make(c, settings);
        const std::size_t e = index_of(*t, "moving_attachment");
        std::size_t p = 0;
        while (std::string_view(t->effect_parameter(e, p).name) != "frequency") ++p;
        return t->effect_parameter(e, p).lower;
    };
    EXPECT_DOUBLE_EQ(slowest_hz(21, 0.25), 1.2 / 5.0);
    EXPECT_DOUBLE_EQ(slowest_hz(201, 0.25), 0.1);
    EXPECT_DOUBLE_EQ(slowest_hz(5, 0.25), 0.5) << "the fastest that is tried";
}

// A place inside, further from all nodes than its radius, acts on the surface next to it: half way between two nodes as
// the mean of both, so that a fit sees which way to move it.
TEST(Effects, APlaceInsideActsOnTheSurfaceNextToIt) {
    const Case c = block();
    const auto at = [&](double x, double z) {
        return nodes_under(c, "unknown_load",
                           {{"force_z", 1e-3},
                            {"center_x", x},
                            {"center_y", 0.01},
                            {"center_z", z},
                            {"radius", 1e-3},
                            {"onset", -1.0}},
                           ElementType::kNodalBlend);
    };
    const std::vector<double> first = at(0.05, 0.03), second = at(0.06, 0.03), between = at(0.055, 0.027);
    double error = 0.0, size = 0.0, apart = 0.0;
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        for (std::size_t a = 0; a < 3; ++a) {
            error += std::pow(between[3 * i + a] - 0.5 * (first[3 * i + a] + second[3 * i + a]), 2);
            size += std::pow(between[3 * i + a] - c.mesh.nodes[i][a], 2);
            apart += std::pow(second[3 * i + a] - first[3 * i + a], 2);
        }
    EXPECT_GT(size, 1e-12);
    EXPECT_GT(apart, 0.01 * size);
    EXPECT_LT(error, 1e-5 * size);
}

// A front of given width crosses a large ball's edge: 0.9 and 0.1 at 2.2 of it to either side (logistic: ln 9); a small
// ball's edge stays 0.15 radii wide.
TEST(Effects, AFrontIsAsSharpAsItIsGiven) {
    const Vector3d centre(0.01, -0.02, 0.03), out(0.6, 0.0, 0.8);
    const double radius = 0.08, edge = 0.003, across = std::log(9.0) * edge;
    EXPECT_NEAR(inside(centre + (radius - across) * out, centre, radius, edge), 0.9, 1e-12);
    EXPECT_NEAR(inside(centre + (radius + across) * out, centre, radius, edge), 0.1, 1e-12);
    for (const double distance : {0.0, 0.009, 0.011})
        EXPECT_EQ(inside(centre + distance * out, centre, 0.01, edge), inside(centre + distance * out, centre, 0.01));
}

// On a plane a patch has the ball's middle as its own, as shape functions reproduce what is linear, and its area is
// that of  2 pi int s inside(s) ds = pi r^2 (1 + (pi 0.15)^2/3)  whatever the mesh: down to a fifth of an edge.
TEST(Effects, APatchIsWhereItsBallIsHoweverSmall) {
    const auto player = *ScenePlayer::make(block(), {});
    Scene& scene = player->scene();
    for (const double radius : {0.002, 0.004, 0.007})
        for (const Vector3d& centre : {Vector3d(0.0413, 0.0158, 0.03), Vector3d(0.0391, 0.0139, 0.03)}) {
            const Patch& patch = surface_patch(scene, centre, radius);
            double total = 0.0;
            Vector3d middle = Vector3d::Zero();
            for (std::size_t k = 0; k < patch.node.size(); ++k) {
                total += patch.area_m2[k];
                middle += patch.area_m2[k] * scene.mesh.X.col(patch.node[k]);
            }
            EXPECT_NEAR(total, patch.total_m2, 1e-9 * total);
            const double area = std::numbers::pi * radius * radius * (1.0 + std::pow(std::numbers::pi * 0.15, 2) / 3.0);
            EXPECT_NEAR(total, area, 0.06 * area) << radius;
            EXPECT_LT((middle / total - centre).norm(), 0.05 * radius) << radius;
        }
}

// Small pressure on one side: a dead traction on the faces with that normal.
TEST(Effects, PressureOnOneSideAsInCalculix) {
    TERES_REQUIRE_CALCULIX();
    const Case c = block();
    auto p = same_in_calculix(c);
    const double pressure = 6.0;
    for (const auto& face : test::faces_on_plane(c.mesh, 2, kSize[2]))
        p.face_tractions.push_back({face, {0.0, 0.0, -pressure}});
    const test::ScratchFolder scratch;
    const auto truth = test::solve_with_calculix(p, scratch.path());
    ASSERT_TRUE(truth) << truth.error().text;
    // lumping on corner nodes: with the linear elements' own quadrature
    const auto x = nodes_under(c, "pressure", {{"pressure", pressure}, {"toward_z", 1.0}});
    EXPECT_LT(difference(c, x, truth->displacement_m), 0.04);
}

// A small force moves the block in proportion to the pulse: F(t) / C = cos wt + a cos 2wt - b sin 2wt.
TEST(Effects, AHeartBeatHasASecondHarmonic) {
    Case c = block();
    c.num_frames = 6;
    const double a = 0.3, b = -0.2, frequency = 1.1;
    const auto x = nodes_under(c, "cardiac",
                               {{"cos_z", 1e-4},
                                {"center_x", 0.08},
                                {"center_y", 0.015},
                                {"center_z", 0.03},
                                {"radius", 0.015},
                                {"frequency", frequency},
                                {"harmonic_cos", a},
                                {"harmonic_sin", b}},
                               ElementType::kNodalBlend);
    const std::size_t N = c.mesh.nodes.size();
    std::size_t tip = 0;
    for (std::size_t i = 0; i < N; ++i)
        if (c.mesh.nodes[i][0] + c.mesh.nodes[i][2] > c.mesh.nodes[tip][0] + c.mesh.nodes[tip][2]) tip = i;
    const auto moved = [&](std::size_t frame) { return x[3 * (frame * N + tip) + 2] - c.mesh.nodes[tip][2]; };
    EXPECT_GT(moved(0), 1e-5);
    for (std::size_t frame = 1; frame < 6; ++frame) {
        const double phase = 2.0 * std::numbers::pi * frequency * 0.2 * double(frame);
        const double pulse = std::cos(phase) + a * std::cos(2.0 * phase) - b * std::sin(2.0 * phase);
        EXPECT_NEAR(moved(frame) / moved(0), pulse / (1.0 + a), 0.01) << frame;
    }
}

// A block all but rigid on springs at its foot, pressed along its axis on its head, beside the springs' middle. The
// push P turns with the head, so its moment about the foot stays P e and turns the block until
//     kappa sin(angle) = P e,   kappa = k sum z_i^2 about the middle of the springs.
// With the push of the last round (kappa - P L) angle = P e - P L last: with kappa = 1.5 P L every round goes twice as
// far back as the last one went too far.
TEST(Effects, PressureTurnsWithABodyThatHangsOnLittle) {
    Case c = block();
    c.body.youngs_modulus_pa = 1e6;
    c.clamped.clear();
    const double pressure = 50.0, push_n = pressure * kSize[1] * kSize[2], length = kSize[0];
    std::vector<std::int32_t> foot;
    double middle = 0.0, squares = 0.0;
    for (const std::int32_t node : test::nodes_on_plane(c.mesh, 0, 0.0))
        if (c.mesh.nodes[static_cast<std::size_t>(node)][2] < 0.9 * kSize[2]) foot.push_back(node);
    const auto z = [&](std::int32_t node) { return c.mesh.nodes[static_cast<std::size_t>(node)][2]; };
    for (const std::int32_t node : foot) middle += z(node) / double(foot.size());
    for (const std::int32_t node : foot) squares += std::pow(z(node) - middle, 2);
    const double kappa = 1.5 * push_n * length;
    for (const std::int32_t node : foot) {
        SpringData spring;
        spring.node_id = node;
        spring.anchor_m = c.mesh.nodes[static_cast<std::size_t>(node)];
        spring.law = SpringLaw::kRestShape;
        spring.k = {kappa / squares, 0.0, 0.0};
        c.springs.push_back(spring);
    }
    const auto x = nodes_under(c, "pressure", {{"pressure", pressure}, {"toward_x", 1.0}}, ElementType::kNodalBlend);
    const auto at = [&](double height) {
        for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
            if (std::abs(c.mesh.nodes[i][0] - length) + std::abs(c.mesh.nodes[i][1]) +
                    std::abs(c.mesh.nodes[i][2] - height) <
                1e-9)
                return Vector3d(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
        return Vector3d(Vector3d::Zero());
    };
    const Vector3d edge = at(kSize[2]) - at(0.0);
    const double sine = push_n * (0.5 * kSize[2] - middle) / kappa;
    EXPECT_GT(sine, 0.02);
    EXPECT_NEAR(std::abs(edge.x()) / edge.norm(), sine, 0.02 * sine);
}

// The effect on a soft nominal body is CalculiX' body with the other modulus.
TEST(Effects, StiffnessAndVolumeModulusAsInCalculix) {
    TERES_REQUIRE_CALCULIX();
    Case c = block();
    c.gravity_m_s2 = {0.0, 0.0, -1.5};
    auto p = same_in_calculix(c);
    p.gravity_m_s2 = c.gravity_m_s2;
    p.material.youngs_modulus_pa = 2.5 * kE;
    const test::ScratchFolder scratch;
    auto truth = test::solve_with_calculix(p, scratch.path());
    ASSERT_TRUE(truth) << truth.error().text;
    EXPECT_LT(difference(c, nodes_under(c, "stiffness", {{"factor", 2.5}}), truth->displacement_m), 0.03);
    p.material.poissons_ratio = 0.25;  // same shear modulus
    p.material.youngs_modulus_pa = kE * 1.25 / (1.0 + kNu);
    truth = test::solve_with_calculix(p, scratch.path());
    ASSERT_TRUE(truth) << truth.error().text;
    EXPECT_LT(difference(c, nodes_under(c, "compressibility", {{"poissons_ratio", 0.25}}), truth->displacement_m),
              0.03);
}

// One third of a bar is stiff: end displacement of bars in series under tension, E1 and E2 by the smooth
// blob's mean. Sphere far larger than the bar's section: the blob is a function of x alone.
TEST(Effects, InclusionIsBarsInSeries) {
    Case c = block(24, 2, 2, 0.0);
    c.load_regions.push_back({"end", {}, {}});
    std::vector<double> weight(c.mesh.nodes.size(), 0.0);
    for (const auto& f : test::faces_on_plane(c.mesh, 0, kSize[0]))
        for (const auto n : f) weight[std::size_t(n)] += 1.0 / 3.0 / 8.0;
    for (std::size_t i = 0; i < weight.size(); ++i)
        if (weight[i] > 0.0) {
            c.load_regions[0].node_ids.push_back(std::int32_t(i));
            c.load_regions[0].weights.push_back(weight[i]);
        }
    const double force = 0.02;
    c.loads = {{0.0, 0, {force, 0.0, 0.0}}};
    const double radius = 0.03;
    const auto x = nodes_under(
        c, "inclusion",
        {{"ratio", 6.0}, {"center_x", kSize[0]}, {"center_y", 0.015}, {"center_z", 0.015}, {"radius", radius}},
        ElementType::kNodalBlend);
    double end = 0.0;
    const auto tip = test::nodes_on_plane(c.mesh, 0, kSize[0]);
    for (const auto n : tip) end += (x[3 * std::size_t(n)] - kSize[0]) / double(tip.size());
    double series = 0.0;  // integral of F / (E(x) A); off-axis distance averaged over the section
    const int steps = 2000;
    for (int i = 0; i < steps; ++i) {
        double modulus = 0.0;
        for (int j = 0; j < 4; ++j)
            for (int k = 0; k < 4; ++k) {
                const Vector3d r(kSize[0] * (1.0 - (i + 0.5) / steps), (j - 1.5) * 0.0075, (k - 1.5) * 0.0075);
                modulus += kE * std::pow(6.0, 1.0 / (1.0 + std::exp((r.norm() / radius - 1.0) / 0.15))) / 16.0;
            }
        series += kSize[0] / steps * force / (modulus * kSize[1] * kSize[2]);
    }
    EXPECT_NEAR(end, series, 0.06 * series);
}

// A sudden steady pull on a bar with relaxation 1 + g exp(-t/tau): strain s0/E (1 - g/(1+g) exp(-t/(tau
// (1+g)))).
TEST(Effects, ViscoelasticCreepIsThatOfTheStandardSolid) {
    Case c = block(4, 1, 1, 0.0, BodyLaw::kNeoHookean);
    c.num_frames = 60;
    c.dt_s = 0.05;
    c.load_regions.push_back({"end", test::nodes_on_plane(c.mesh, 0, kSize[0]), {0.25, 0.25, 0.25, 0.25}});
    const double force = 5e-3, g = 0.8, tau = 0.9;
    c.loads = {{0.0, 0, {force, 0.0, 0.0}}};
    const auto x = nodes_under(c, "viscoelasticity", {{"g", g}, {"tau", tau}}, ElementType::kLinear);
    const auto elastic = nodes_under(c, "viscoelasticity", {}, ElementType::kLinear);
    const std::size_t N = 3 * c.mesh.nodes.size(), tip = 3 * std::size_t(c.load_regions[0].node_ids[0]);
    const double limit = elastic[tip] - kSize[0];
    // nu = 0: the shear part carries all of psi but lambda = 0, so the whole bar relaxes
    for (const std::size_t f : {std::size_t(4), std::size_t(20), std::size_t(59)}) {
        const double t = 0.05 * (double(f) + 0.5);  // the load comes within the first step
        const double creep = limit * (1.0 - g / (1.0 + g) * std::exp(-t / (tau * (1.0 + g))));
        EXPECT_NEAR(x[f * N + tip] - kSize[0], creep, 0.015 * limit) << "frame " << f;
    }
}

// A body on one ligament under a steady pull F: it moves F/k; when a share of the ligament is lost, F/(k (1 -
// loss)).
TEST(Effects, TornLigamentDropsByHandCalculation) {
    Case c = block(4, 2, 2, 0.3);
    c.body.youngs_modulus_pa = 1e8;  // rigid against the ligament
    c.num_frames = 5;
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 1e4, 0.45, 0.02, 0.03, 0.0};
    for (const auto n : c.clamped) c.ligament_prior.push_back({n, 0.9});
    c.clamped.clear();
    c.load_regions.push_back({"all", {}, {}});
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i) {
        c.load_regions[0].node_ids.push_back(std::int32_t(i));
        c.load_regions[0].weights.push_back(1.0 / double(c.mesh.nodes.size()));
    }
    const double force = 0.05, stiffness = 40.0, loss = 0.6;
    c.loads = {{0.0, 0, {force, 0.0, 0.0}}};
    const Values tear{{"loss", loss},  {"center_x", 0.0}, {"center_y", 0.015}, {"center_z", 0.015},
                      {"radius", 0.5}, {"onset", 0.3},    {"duration", 0.01}};
    const auto x = nodes_under(c, "ligament_tear", tear, ElementType::kNodalBlend, {stiffness});
    // edge nodes of the face have slanting normals: stiffness and slack along x are sums over them
    PlayerSettings settings;
    settings.model.ligament.num_groups = 1;
    auto t = *Trajectory::make(c, settings);
    double k = 0.0, pull = 0.0;
    for (const Tether& tether : t->player().scene().parts.tethers) {
        k += stiffness * tether_stiffness(tether, tether.band.rest)(0, 0);
        pull -= stiffness * tether.share * tether.band.normal.x();
    }
    const std::size_t N = 3 * c.mesh.nodes.size();
    const auto mean_x = [&](std::size_t f) {
        double u = 0.0;
        for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
            u += (x[f * N + 3 * i] - c.mesh.nodes[i][0]) / double(c.mesh.nodes.size());
        return u;
    };
    EXPECT_NEAR(mean_x(1), force / k, 0.01 * force / k);
    const double torn = 1.0 - loss / (1.0 + std::exp((0.0 / 0.5 - 1.0) / 0.15));  // inside() at the centre
    EXPECT_NEAR(mean_x(4), force / (k * torn), 0.01 * force / (k * torn));

    // The anchor of the same ligament moves by b: so does the body. It breathes out of rest, -c cos pi + c half a
    // period later; imaged a quarter of a period later, it is off by -c at the beginning and by c then.
    const auto breathing = [&](double rest_phase, std::size_t f) {
        const double half_period_s = 4.0 * c.dt_s;
        const auto moved = nodes_under(
            c, "moving_attachment", {{"cos_y", -0.004}, {"frequency", 0.5 / half_period_s}, {"rest_phase", rest_phase}},
            ElementType::kNodalBlend, {stiffness});
        double uy = 0.0;
        for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
            uy += (moved[f * N + 3 * i + 1] - c.mesh.nodes[i][1]) / double(c.mesh.nodes.size());
        return uy;
    };
    EXPECT_NEAR(breathing(0.0, 0), 0.0, 4e-5);
    EXPECT_NEAR(breathing(0.0, 4), 0.008, 8e-5);
    EXPECT_NEAR(breathing(0.25, 0), -0.004, 4e-5);
    EXPECT_NEAR(breathing(0.25, 4), 0.004, 4e-5);

    // Slack: the rest place moves by -s along the outward normal -x, the pull stretches it by F/k from there.
    const auto slack =
        nodes_under(c, "ligament_slack",
                    {{"shift", 0.002}, {"center_x", 0.0}, {"center_y", 0.015}, {"center_z", 0.015}, {"radius", 0.5}},
                    ElementType::kNodalBlend, {stiffness});
    double ux = 0.0;
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        ux += (slack[4 * N + 3 * i] - c.mesh.nodes[i][0]) / double(c.mesh.nodes.size());
    EXPECT_NEAR(ux, force / k + 0.002 * pull / k, 0.01 * ux);
}

// A stiff block pulled against a plane obstacle: it stops at the gap plus F/(k A).
TEST(Effects, ContactStopsTheBlock) {
    Case c = block(4, 3, 3, 0.0);
    c.load_regions.push_back({"end", test::nodes_on_plane(c.mesh, 0, kSize[0]), {}});
    c.load_regions[0].weights.assign(c.load_regions[0].node_ids.size(),
                                     1.0 / double(c.load_regions[0].node_ids.size()));
    const double area = kSize[1] * kSize[2], force = 2.0, gap = 0.003, k = 2e8;
    c.loads = {{0.0, 0, {force, 0.0, 0.0}}};
    const auto x = nodes_under(c, "contact",
                               {{"stiffness", k},
                                {"center_x", kSize[0]},
                                {"center_y", 0.015},
                                {"center_z", 0.015},
                                {"gap", gap},
                                {"radius", 2.0}},
                               ElementType::kNodalBlend);
    double end = 0.0;
    for (const auto n : c.load_regions[0].node_ids)
        end += (x[3 * std::size_t(n)] - kSize[0]) / double(c.load_regions[0].node_ids.size());
    EXPECT_NEAR(end, gap + force / (k * area), 0.15 * gap);  // against 9.7 mm and more without the obstacle
}

// A layer of the body's own tissue under the clamp, four times as thick on one side as on the other: whatever the block
// does, the layer holds what pulls at it, sum of A_i E' u_i / h_i = F.
TEST(Effects, SoftClampIsALayerOfTissue) {
    Case c = block(4, 3, 3, 0.0);
    c.load_regions.push_back({"end", test::nodes_on_plane(c.mesh, 0, kSize[0]), {}});
    c.load_regions[0].weights.assign(c.load_regions[0].node_ids.size(),
                                     1.0 / double(c.load_regions[0].node_ids.size()));
    const double force = 0.05, layer = 0.004;
    c.loads = {{0.0, 0, {force, 0.0, 0.0}}};
    const double size_m = Eigen::Vector3d(kSize[0], kSize[1], kSize[2]).norm();
    std::map<NodeIndex, double> area;  // of the foot's triangles, a third to each node
    for (const auto& tet : c.mesh.tets)
        for (std::size_t skip = 0; skip < 4; ++skip) {
            std::vector<Eigen::Vector3d> at;
            for (std::size_t i = 0; i < 4; ++i)
                if (i != skip) at.emplace_back(Eigen::Vector3d(c.mesh.nodes[std::size_t(tet[i])].data()));
            if (at[0].x() + at[1].x() + at[2].x() > 1e-12) continue;
            for (std::size_t i = 0; i < 4; ++i)
                if (i != skip) area[tet[i]] += (at[1] - at[0]).cross(at[2] - at[0]).norm() / 6.0;
        }
    for (const double tilt : {0.0, std::log(4.0) * size_m / kSize[1]}) {
        const auto x =
            nodes_under(c, "clamp_compliance", {{"layer", layer}, {"tilt_y", tilt}}, ElementType::kNodalBlend);
        double held = 0.0;
        for (const auto& [n, a] : area) {
            const double h = layer * std::exp(tilt / size_m * (c.mesh.nodes[std::size_t(n)][1] - 0.5 * kSize[1]));
            held += a * 1.5 * kE / h * x[3 * std::size_t(n)];  // at nu = 0 the layer's modulus 3 mu is 1.5 E
        }
        EXPECT_NEAR(held, force, 0.05 * force) << "tilt " << tilt;
    }
}

}  // namespace
}  // namespace teres
