// Whole recordings under hypotheses: the null hypothesis is the forward model, first order is the derivative
// of the simulation, every tangent is that of its gradient.
#include "plugins/simulation/trajectory.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <future>
#include <numeric>
#include <set>
#include <string_view>

#include "core/case/load_tracks.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

using Eigen::VectorXd;

// A block on a ligament at x = 0 that also has a clamped edge, loaded at its far face.
Case block(bool quasi_static = true) {
    Case c = test::hung_on_ligament(test::clamped_block({.size_m = {0.10, 0.04, 0.04},
                                                         .cells = {8, 3, 3},
                                                         .law = BodyLaw::kNeoHookean,
                                                         .youngs_modulus_pa = 15e3,
                                                         .poissons_ratio = 0.45,
                                                         .frames = 6,
                                                         .dt_s = 0.2,
                                                         .quasi_static = quasi_static,
                                                         .full_force_n = {0.03, 0.05, -0.08}}));
    c.loads[0].force_n = {0.0, -0.02, 0.01};
    c.sensor.camera_position_m = Point{0.05, 0.02, 0.4};
    return c;
}

PlayerSettings exact() {
    PlayerSettings s;
    s.model.ligament.num_groups = 3;
    s.model.equilibrium.relative_residual = 1e-7;
    s.model.equilibrium.max_iterations = 200;
    s.model.max_step_s = 0.05;
    return s;
}

std::vector<double> prior(const TrajectoryModel& t) {
    std::vector<double> theta;
    for (std::size_t p = 0; p < t.num_parameters(); ++p) theta.push_back(std::exp(t.parameter(p).prior_log_mean));
    return theta;
}

std::vector<double> markers_under(Trajectory& t, const std::vector<double>& theta,
                                  const std::vector<EffectInstance>& effects) {
    std::vector<double> z(t.num_frames() * 3 * t.num_markers());
    const TrajectoryReport r = t.simulate({theta, effects}, z, {}, {});
    EXPECT_EQ(r.frames_converged, r.frames)
        << (effects.empty() ? "nominal" : t.effect(std::size_t(effects[0].index)).id);
    return z;
}

// An edge on the thin layer that stands for a clamp is as good as clamped; the rest is the same model.
TEST(Trajectory, NominalIsTheForwardModel) {
    const Case c = block();
    auto t = *Trajectory::make(c, exact());
    auto model = *CaseModel::make(c, exact().model);
    const auto theta = prior(*t);
    const auto z = markers_under(*t, theta, {});
    VectorXd x(static_cast<Eigen::Index>(model->num_state()));
    model->rest_state({x.data(), model->num_state()});
    std::vector<double> seen(3 * model->num_markers());
    double error = 0.0, moved = 0.0;
    for (std::size_t f = 0; f < t->num_frames(); ++f) {
        const Point& force = c.loads[f].force_n;
        model->advance({t->time_s(f), 0.2, force, {}}, theta, {x.data(), model->num_state()}, 1);
        model->observe({x.data(), model->num_state()}, seen, 1);
        for (std::size_t i = 0; i < seen.size(); ++i) {
            error = std::max(error, std::abs(seen[i] - z[f * seen.size() + i]));
            moved = std::max(moved, std::abs(seen[i] - z[i]));
        }
    }
    EXPECT_GT(moved, 3e-3);
    EXPECT_LT(error, 2e-3 * moved);
}

// By hand: weight pulls every node by its mass, so the forces sum to M g; a ligament that lets go half way misses at
// its own nodes only.
TEST(Trajectory, ForcesOfAnEffectStandWhereItActs) {
    const Case c = block();
    auto t = *Trajectory::make(c, exact());
    const auto index_of = [&](std::string_view id) {
        std::int32_t e = 0;
        while (t->effect(static_cast<std::size_t>(e)).id != id) ++e;
        return e;
    };
    const std::vector<double> g{0.0, 0.0, -2.0}, torn{0.9, 0.0, 0.02, 0.02, 0.05, 0.5, 0.01};
    const std::vector<EffectInstance> effects{{index_of("gravity"), g}, {index_of("ligament_tear"), torn}};
    std::vector<double> force(t->num_nodes());
    EXPECT_FALSE(t->effect_forces(0, force)) << "no trajectory yet";
    markers_under(*t, prior(*t), effects);
    ASSERT_TRUE(t->effect_forces(0, force));
    const double mass = 0.10 * 0.04 * 0.04 * c.body.density_kg_m3;
    EXPECT_NEAR(std::accumulate(force.begin(), force.end(), 0.0), 2.0 * mass, 1e-6 * mass);
    ASSERT_TRUE(t->effect_forces(1, force));
    double at_ligament = 0.0, elsewhere = 0.0;
    for (std::size_t i = 0; i < force.size(); ++i) (c.mesh.nodes[i][0] == 0.0 ? at_ligament : elsewhere) += force[i];
    EXPECT_GT(at_ligament, 1e-3);
    EXPECT_LT(elsewhere, 1e-12);
    EXPECT_FALSE(t->effect_forces(2, force));
}

TEST(Trajectory, LigamentsHoldByTheirNodes) {
    Case c = block();
    auto t = *Trajectory::make(c, exact());
    std::vector<double> share(t->num_nodes());
    ASSERT_TRUE(t->ligament_shares(share));
    EXPECT_NEAR(std::accumulate(share.begin(), share.end(), 0.0), 1.0, 1e-12);
    std::size_t holding = 0;
    for (std::size_t i = 0; i < share.size(); ++i)
        if (share[i] > 0.0) {
            ++holding;
            EXPECT_TRUE(c.mesh.nodes[i][0] == 0.0 && c.mesh.nodes[i][1] > 0.0) << "node " << i;
        }
    EXPECT_EQ(holding, c.ligament_prior.size());
    c.ligament.reset();
    c.ligament_prior.clear();
    EXPECT_FALSE((*Trajectory::make(c, exact()))->ligament_shares(share)) << "a clamp alone";
}

// All effects of the catalogue, each at a candidate of its own.
struct Sample {
    std::size_t effect;
    std::vector<double> values;
};
std::vector<Sample> samples(const Trajectory& t) {
    std::vector<Sample> out;
    for (std::size_t e = 0; e < t.num_effects(); ++e) {
        const EffectInfo info = t.effect(e);
        for (const std::int32_t k : {0, info.num_candidates / 2}) {
            if (k >= info.num_candidates ||
                (k == 0 && info.num_candidates == 1 && !out.empty() && out.back().effect == e))
                continue;
            Sample s{e, std::vector<double>(std::size_t(info.num_parameters))};
            t.effect_candidate(e, std::size_t(k), s.values);
            out.push_back(std::move(s));
        }
    }
    return out;
}

// The amplitudes at `share` of the way from null to the candidate.
std::vector<double> scaled(const Trajectory& t, const Sample& s, double share) {
    std::vector<double> values = s.values;
    for (std::size_t p = 0; p < values.size(); ++p) {
        const EffectParameter parameter = t.effect_parameter(s.effect, p);
        if (parameter.role == EffectRole::kAmplitude)
            values[p] = parameter.null_value + share * (values[p] - parameter.null_value);
    }
    return values;
}

TEST(Trajectory, NullValuesAreNominalExactly) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    const auto nominal = markers_under(*t, theta, {});
    for (const Sample& s : samples(*t)) {
        const auto values = scaled(*t, s, 0.0);
        const std::vector<EffectInstance> on{{std::int32_t(s.effect), values}};
        std::vector<double> z(nominal.size());
        std::vector<Hypothesis> others{{theta, on}};
        ASSERT_TRUE(t->first_order(others, z, {}));
        for (const double v : z) ASSERT_EQ(v, 0.0) << t->effect(s.effect).id;
    }
}

// A third of the frames solved: every effect grown to a candidate's size (the heart, which beats faster than the
// frames, to a push of a millimetre, half of that), and other ligaments.
TEST(Trajectory, ApproximateIsSimulateWithinATenthOfTheChange) {
    Case c = block();
    const LoadSample load = c.loads[0];
    c.loads.clear();
    c.observations.clear();
    for (int f = 0; f < 40; ++f) {
        LoadSample sample = load;
        sample.t_s = 0.2 * f;
        sample.force_n = {0.01 * std::sin(1.1 * sample.t_s), -0.02 * std::sin(0.7 * sample.t_s), 0.01};
        c.loads.push_back(sample);
        for (const auto& m : c.markers) c.observations.push_back({sample.t_s, m.id, m.position_m});
    }
    auto t = *Trajectory::make(c, exact());
    ASSERT_EQ(t->num_frames(), 40u);
    auto theta = prior(*t);
    const auto compare = [&](const char* name, const std::vector<double>& from_theta,
                             const std::vector<EffectInstance>& from, const std::vector<EffectInstance>& to) {
        const auto start = markers_under(*t, from_theta, from);
        std::vector<double> z(start.size());
        const TrajectoryReport r = t->approximate({theta, to}, z);
        EXPECT_EQ(r.frames_converged, r.frames) << name;
        const auto whole = markers_under(*t, theta, to);
        const Eigen::Map<const VectorXd> a(z.data(), std::ssize(z)), b(whole.data(), std::ssize(whole)),
            n(start.data(), std::ssize(start));
        EXPECT_LE((a - b).norm(), 0.1 * (b - n).norm() + 1e-6) << name;
    };
    for (const Sample& s : samples(*t)) {
        const std::string id = t->effect(s.effect).id;
        const double size = id == "cardiac" ? 0.5 : 1.0;
        const auto part = scaled(*t, s, 0.6 * size), whole = scaled(*t, s, size);
        compare(id.c_str(), theta, {{std::int32_t(s.effect), part}}, {{std::int32_t(s.effect), whole}});
    }
    auto softer = theta;
    for (double& v : softer) v *= 0.5;
    compare("ligaments", softer, {}, {});
}

TEST(Trajectory, CandidatesLieWithinBounds) {
    auto t = *Trajectory::make(block(), exact());
    std::set<std::string> ids;
    for (std::size_t e = 0; e < t->num_effects(); ++e) {
        const EffectInfo info = t->effect(e);
        EXPECT_TRUE(ids.insert(info.id).second);
        EXPECT_EQ(info.num_candidates == 0, info.not_applicable != nullptr) << info.id;
        std::vector<double> values(std::size_t(info.num_parameters));
        for (std::int32_t k = 0; k < info.num_candidates; ++k) {
            t->effect_candidate(e, std::size_t(k), values);
            for (std::size_t p = 0; p < values.size(); ++p) {
                EXPECT_GE(values[p], t->effect_parameter(e, p).lower)
                    << info.id << "." << t->effect_parameter(e, p).name;
                EXPECT_LE(values[p], t->effect_parameter(e, p).upper)
                    << info.id << "." << t->effect_parameter(e, p).name;
            }
        }
    }
    EXPECT_EQ(ids, (std::set<std::string>{"stiffness", "inclusion", "viscoelasticity", "material_law",
                                          "compressibility", "damping", "inertia", "cut", "extra_attachment",
                                          "ligament_slack", "ligament_tear", "moving_attachment", "clamp_compliance",
                                          "contact", "gravity", "pressure", "load_scale", "unknown_load", "cardiac"}));
}

// First order about a base with effects on: the derivative of the simulation, by differences of it.
TEST(Trajectory, FirstOrderIsTheDerivativeOfTheSimulation) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    for (const Sample& s : samples(*t)) {
        const double h = 1e-3;
        const auto plus = scaled(*t, s, h), zero = scaled(*t, s, 0.0);
        const std::vector<EffectInstance> on{{std::int32_t(s.effect), plus}};
        const auto moved = markers_under(*t, theta, on);
        const auto nominal = markers_under(*t, theta, {});
        std::vector<double> linear(nominal.size());
        const std::vector<Hypothesis> others{{theta, on}};
        ASSERT_TRUE(t->first_order(others, linear, {}));
        double error = 0.0, size = 0.0;
        for (std::size_t i = 0; i < linear.size(); ++i) {
            error += std::pow(moved[i] - nominal[i] - linear[i], 2);
            size += std::pow(moved[i] - nominal[i], 2);
        }
        EXPECT_LT(std::sqrt(error), 0.03 * std::sqrt(size) + 1e-8) << t->effect(s.effect).id;
        EXPECT_GT(size, 0.0) << t->effect(s.effect).id;
    }
}

// A vibrating block: the modes answer as the nonlinear simulation does, for small changes and while phases
// agree.
TEST(Trajectory, FirstOrderOfAVibratingBody) {
    Case c = block(false);
    c.num_frames = 16;
    c.dt_s = 0.02;
    c.observations.clear();
    c.loads = {{0.0, 0, {0.01, 0.02, -0.02}}};
    c.body.rayleigh_mass_1_s = 1.0;
    PlayerSettings settings = exact();
    settings.model.max_step_s = 0.005;
    settings.model.spectral_radius = 1.0;
    settings.model.equilibrium.relative_residual = 1e-6;
    auto t = *Trajectory::make(c, settings);
    const auto theta = prior(*t);
    const auto nominal = markers_under(*t, theta, {});
    std::vector<double> linear(nominal.size());
    const std::set<std::string> chosen{"stiffness", "damping", "gravity", "load_scale"};
    for (const Sample& s : samples(*t)) {
        const std::string id = t->effect(s.effect).id;
        if (!chosen.contains(id)) continue;
        const auto plus = scaled(*t, s, 0.02);
        const std::vector<EffectInstance> on{{std::int32_t(s.effect), plus}};
        const std::vector<Hypothesis> others{{theta, on}};
        const auto moved = markers_under(*t, theta, on);
        markers_under(*t, theta, {});
        ASSERT_TRUE(t->first_order(others, linear, {}));
        double error = 0.0, size = 0.0;
        for (std::size_t i = 0; i < linear.size(); ++i) {
            error += std::pow(moved[i] - nominal[i] - linear[i], 2);
            size += std::pow(moved[i] - nominal[i], 2);
        }
        EXPECT_LT(std::sqrt(error / size), 0.3) << id;
    }
}

// The same block in the subspace of its own motion, modes and statics, from 0.6 of an effect to all of it, all phases.
TEST(Trajectory, ApproximateOfAVibratingBody) {
    Case c = block(false);
    c.num_frames = 24;
    c.dt_s = 0.02;
    c.observations.clear();
    c.loads = {{0.0, 0, {0.01, 0.02, -0.02}}};
    PlayerSettings settings = exact();
    settings.model.max_step_s = 0.005;
    settings.model.equilibrium.relative_residual = 1e-6;
    auto t = *Trajectory::make(c, settings);
    const auto theta = prior(*t);
    const std::set<std::string> chosen{"stiffness", "damping", "gravity", "load_scale", "inertia"};
    std::size_t tried = 0;
    for (const Sample& s : samples(*t)) {
        const std::string id = t->effect(s.effect).id;
        if (!chosen.contains(id)) continue;
        ++tried;
        const std::vector<EffectInstance> on{{std::int32_t(s.effect), s.values}};
        const auto part = scaled(*t, s, 0.6);
        const auto nominal = markers_under(*t, theta, {{std::int32_t(s.effect), part}});
        std::vector<double> z(nominal.size());
        const TrajectoryReport r = t->approximate({theta, on}, z);
        EXPECT_EQ(r.frames_converged, r.frames) << id;
        const auto whole = markers_under(*t, theta, on);
        const Eigen::Map<const VectorXd> a(z.data(), std::ssize(z)), b(whole.data(), std::ssize(whole)),
            n(nominal.data(), std::ssize(nominal));
        std::printf("%-12s change %.4g, error %.4g\n", id.c_str(), (b - n).norm(), (a - b).norm());
        EXPECT_LE((a - b).norm(), 0.15 * (b - n).norm() + 1e-6) << id;  // worst: gravity, by turns of half a radian
    }
    EXPECT_GE(tried, chosen.size());
}

// dg/dx of the whole system under every effect, column by column along random directions.
TEST(Trajectory, TangentIsTheDerivativeOfTheGradient) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    auto& system = t->player().model().system();
    const std::size_t dofs = 3 * system.num_nodes(), stride = padded_lanes(1);
    for (const Sample& s : samples(*t)) {
        const std::vector<EffectInstance> on{{std::int32_t(s.effect), s.values}};
        ExternalActions actions;
        t->player().enter(0.8, {theta, on}, t->effects(), actions);
        ViscousMemory memory;
        VectorXd x = system.parts().X.reshaped();
        for (Eigen::Index d = 0; d < x.size(); ++d) x(d) += 1e-3 * std::sin(1.0 + 7.0 * double(d));
        memory.finish_step(t->player().scene().viscosity, 0.2, system.parts().body, x.data());
        memory.enter_step(t->player().scene().viscosity, 0.2, t->player().scene().body_points());
        std::vector<double> theta_batch;
        for (const double p : theta) theta_batch.insert(theta_batch.end(), stride, p);
        const auto gradient = [&](const VectorXd& at) {
            std::vector<double> batch, g(dofs * stride), energy(stride);
            for (const double v : at) batch.insert(batch.end(), stride, v);
            system.gradient(actions, {}, theta_batch.data(), batch.data(), g.data(), energy.data(), stride, 1);
            VectorXd out(at.size());
            for (Eigen::Index d = 0; d < out.size(); ++d) out(d) = g[std::size_t(d) * stride];
            return std::pair(out, energy[0]);
        };
        for (Eigen::Index d = 0; d < x.size(); ++d) x(d) += 5e-4 * std::cos(2.0 + 3.0 * double(d));
        VectorXd u(x.size());
        for (Eigen::Index d = 0; d < u.size(); ++d) u(d) = std::sin(11.0 * double(d) + 0.3);
        const double h = 1e-7;
        const auto [plus, e_plus] = gradient(x + h * u);
        const auto [minus, e_minus] = gradient(x - h * u);
        EXPECT_NEAR((e_plus - e_minus) / (2.0 * h), gradient(x).first.dot(u),
                    2e-5 * gradient(x).first.norm() * u.norm())
            << t->effect(s.effect).id;
        std::vector<double> values;
        const Positions positions = Eigen::Map<const Positions>(x.data(), 3, x.size() / 3);
        ASSERT_TRUE(system.tangent(actions, {}, 0, theta.data(), positions, values));
        VectorXd Ku = VectorXd::Zero(system.pattern().num_rows()), uf = Ku, gf = Ku;
        for (std::size_t i = 0; i < system.num_nodes(); ++i)
            if (const auto row = system.pattern().free_index(NodeIndex(i)); row >= 0) {
                uf.segment<3>(3 * row) = u.segment<3>(3 * Eigen::Index(i));
                gf.segment<3>(3 * row) = (plus - minus).segment<3>(3 * Eigen::Index(i)) / (2.0 * h);
            }
        system.pattern().multiply(values, uf.data(), Ku.data());
        EXPECT_LT((Ku - gf).norm(), 1e-5 * gf.norm()) << t->effect(s.effect).id;
    }
}

// A hypothesis is a function of its values alone: the order of calls does not matter.
TEST(Trajectory, SimulationDoesNotRememberTheLastOne) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    const auto before = markers_under(*t, theta, {});
    for (const Sample& s : samples(*t))
        markers_under(*t, theta, std::vector<EffectInstance>{{std::int32_t(s.effect), s.values}});
    const auto after = markers_under(*t, theta, {});
    for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(before[i], after[i], 1e-8);
}

TEST(Trajectory, ATwinIsTheSameModelWithAStateOfItsOwn) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    const auto before = markers_under(*t, theta, {});
    TrajectoryModel* twin = t->twin();
    ASSERT_NE(twin, nullptr);
    EXPECT_EQ(t->twin(), twin) << "made once";
    std::vector<double> z(before.size()), tangent(before.size()), again(before.size());
    const Sample s = samples(*t).front();
    const std::vector<EffectInstance> effect{{std::int32_t(s.effect), s.values}};
    const Hypothesis other{theta, effect};
    ASSERT_TRUE(t->first_order({&other, 1}, tangent, {}));
    twin->simulate(other, z, {}, {});  // does not move the base of the first
    ASSERT_TRUE(t->first_order({&other, 1}, again, {}));
    EXPECT_EQ(tangent, again);
    twin->simulate({theta, {}}, z, {}, {});
    for (std::size_t i = 0; i < z.size(); ++i) EXPECT_NEAR(z[i], before[i], 1e-8);
}

// Frames and hypotheses that the twin solves are those that the model solves alone.
TEST(Trajectory, ATwinTakesItsShare) {
    Case c = block();
    const LoadSample load = c.loads[0];
    c.loads.clear();
    c.observations.clear();
    for (int f = 0; f < 40; ++f) {
        LoadSample sample = load;
        sample.t_s = 0.2 * f;
        sample.force_n = {0.01 * std::sin(1.1 * sample.t_s), -0.02 * std::sin(0.7 * sample.t_s), 0.01};
        c.loads.push_back(sample);
        for (const auto& m : c.markers) c.observations.push_back({sample.t_s, m.id, m.position_m});
    }
    auto alone = *Trajectory::make(c, exact()), both = *Trajectory::make(c, exact());
    both->share_with_twin(true);
    const auto theta = prior(*alone);
    std::vector<std::vector<EffectInstance>> effects;
    const auto all = samples(*alone);
    for (const Sample& s : all) effects.push_back({{std::int32_t(s.effect), s.values}});
    std::vector<Hypothesis> others;
    for (const auto& e : effects) others.push_back({theta, e});
    const auto expect_same = [](const std::vector<double>& a, const std::vector<double>& b, double within,
                                const char* what) {
        for (std::size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(a[i], b[i], within) << what << ", " << i;
    };
    markers_under(*both, theta, {});  // the first trajectory: nothing is known to start from
    for (const Hypothesis& h : others) {
        const std::vector<EffectInstance> on(h.effects.begin(), h.effects.end());
        const char* name = both->effect(std::size_t(on[0].index)).id;
        expect_same(markers_under(*alone, theta, {}), markers_under(*both, theta, {}), 1e-7, name);
        const auto size = 3 * alone->num_markers() * alone->num_frames();
        std::vector<double> a(size), b(size);
        alone->approximate(h, a);
        both->approximate(h, b);
        expect_same(a, b, 5e-6, name);
        expect_same(markers_under(*alone, theta, on), markers_under(*both, theta, on), 5e-6, name);
    }
    markers_under(*alone, theta, {});
    markers_under(*both, theta, {});
    std::vector<double> a(others.size() * 3 * alone->num_markers() * alone->num_frames()), b(a.size());
    ASSERT_TRUE(alone->first_order(others, a, {}));
    ASSERT_TRUE(both->first_order(others, b, {}));
    double largest = 0.0;
    for (const double v : a) largest = std::max(largest, std::abs(v));
    expect_same(a, b, 1e-3 * largest, "first order");
}

TEST(Trajectory, SomeFramesAreThoseOfAllAndLeaveTheBase) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    const std::size_t M = 3 * t->num_markers();
    const std::vector<std::int32_t> frames{1, 4};
    for (const Sample& s : samples(*t)) {
        const std::vector<EffectInstance> effect{{std::int32_t(s.effect), s.values}};
        const auto all = markers_under(*t, theta, effect), nominal = markers_under(*t, theta, {});
        double moved = 0.0;
        for (std::size_t i = 0; i < all.size(); ++i) moved = std::max(moved, std::abs(all[i] - nominal[i]));
        const Hypothesis softer{theta, effect};
        std::vector<double> z(frames.size() * M), tangent(all.size()), again(all.size());
        ASSERT_TRUE(t->first_order({&softer, 1}, tangent, {}));
        EXPECT_EQ(t->simulate_at(softer, frames, z).frames_converged, 2) << t->effect(s.effect).id;
        for (std::size_t k = 0; k < frames.size(); ++k)
            for (std::size_t i = 0; i < M; ++i)
                EXPECT_NEAR(z[k * M + i], all[std::size_t(frames[k]) * M + i],
                            1e-7 + 0.02 * moved)  // a pressure ends at 1e-3 of its force, most of which moves nothing
                    << t->effect(s.effect).id;
        ASSERT_TRUE(t->first_order({&softer, 1}, again, {}));
        EXPECT_EQ(tangent, again) << t->effect(s.effect).id;
    }
}

TEST(Trajectory, MarkerComplianceIsTheResponseToAUnitForce) {
    Case c = block();
    auto t = *Trajectory::make(c, exact());
    const auto theta = prior(*t);
    markers_under(*t, theta, {});
    const std::int32_t node = c.load_regions[0].node_ids.front();
    std::vector<double> C(t->num_frames() * 3 * t->num_markers() * 3);
    ASSERT_TRUE(t->marker_compliance(node, C));
    const double force = 1e-5;
    Case pushed = c;
    pushed.load_regions.push_back({"node", {node}, {1.0}});
    for (std::size_t f = 0; f < t->num_frames(); ++f) pushed.loads.push_back({t->time_s(f), 1, {0.0, force, 0.0}});
    std::sort(pushed.loads.begin(), pushed.loads.end(), [](const auto& a, const auto& b) { return a.t_s < b.t_s; });
    auto other = *Trajectory::make(pushed, exact());
    const auto moved = markers_under(*other, theta, {}), nominal = markers_under(*t, theta, {});
    double error = 0.0, size = 0.0;
    for (std::size_t r = 0; r < moved.size(); ++r) {
        error = std::max(error, std::abs((moved[r] - nominal[r]) / force - C[3 * r + 1]));
        size = std::max(size, std::abs(C[3 * r + 1]));
    }
    EXPECT_LT(error, 5e-3 * size);
}

TEST(Trajectory, VariantsConvergeAndDiffer) {
    Case c = block();
    c.validation_rest = c.markers;  // what nothing observes is predicted as what is seen at the same place
    auto t = *Trajectory::make(c, exact());
    const auto theta = prior(*t);
    const auto nominal = markers_under(*t, theta, {});
    const std::vector<std::int32_t> frames{2, 5};
    const std::size_t M = 3 * t->num_markers();
    bool wider = false;
    for (std::size_t v = 0; v < t->num_variants(); ++v) {
        std::vector<double> z(frames.size() * M), points(z.size());
        const TrajectoryReport r = t->simulate_variant(v, {theta, {}}, frames, z, points);
        for (std::size_t i = 0; i < z.size(); ++i) EXPECT_NEAR(points[i], z[i], 1e-6) << t->variant_name(v);
        EXPECT_EQ(r.frames_converged, 2) << t->variant_name(v);
        double difference = 0.0, moved = 0.0;
        for (std::size_t i = 0; i < M; ++i) {
            difference = std::max(difference, std::abs(z[M + i] - nominal[5 * M + i]));
            moved = std::max(moved, std::abs(nominal[5 * M + i] - nominal[i]));
        }
        EXPECT_GT(difference, 1e-6) << t->variant_name(v);
        EXPECT_LT(difference, 0.5 * moved) << t->variant_name(v);
        if (t->variant_name(v) != std::string("wider clamps")) continue;
        double own = 0.0;
        for (std::size_t i = 0; i < M; ++i) own = std::max(own, std::abs(z[M + i] - nominal[i]));
        EXPECT_LT(own, moved) << "held further out it moves less";
        wider = true;
    }
    EXPECT_TRUE(wider);
}

// As the gap diagnosis asks for them: two threads, one model.
TEST(Trajectory, VariantsAskedAtOnceAreThoseAskedInTurn) {
    auto t = *Trajectory::make(block(), exact());
    const auto theta = prior(*t);
    markers_under(*t, theta, {});
    const std::vector<std::int32_t> frames{1, 3, 5};
    const std::size_t count = t->num_variants(), rows = frames.size() * 3 * t->num_markers();
    const auto ask = [&](std::size_t v) {
        std::vector<double> z(rows);
        EXPECT_EQ(t->simulate_variant(v, {theta, {}}, frames, z, {}).frames_converged, 3) << t->variant_name(v);
        return z;
    };
    std::vector<std::vector<double>> in_turn;
    for (std::size_t v = 0; v < count; ++v) in_turn.push_back(ask(v));
    for (std::size_t v = 0; v + 1 < count; ++v) {
        auto other = std::async(std::launch::async, ask, v + 1);
        EXPECT_EQ(ask(v), in_turn[v]);
        EXPECT_EQ(other.get(), in_turn[v + 1]);
    }
}

}  // namespace
}  // namespace teres
