#include "plugins/simulation/gradient_change.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr std::size_t kLookedAtTogether = 64;  // strain points, for what changed

}  // namespace

void GradientChange::enter_frame(const Hypothesis& h, std::size_t f, const ViscousMemory& memory,
                                 ExternalActions& actions) const {
    player_.enter(player_.times()[f], h, effects_, actions);
    Scene& scene = player_.scene();
    if (scene.viscosity.empty()) return;  // body_points() counts as a change of the body
    memory.enter_step(scene.viscosity, player_.step_s(f), scene.body_points());
}

void GradientChange::leave_frame(std::size_t f, const std::vector<ViscousBranch>& viscosity,
                                 ViscousMemory& memory) const {
    if (viscosity.empty()) return;
    const Body& body = player_.scene().parts.body;
    std::vector<std::vector<double>> S;
    const BaseTrajectory::FrameState& state = base_.stresses_at(f, body);
    for (std::size_t s = 0; s < state.size(); ++s)
        if (body.points()[s].part.shear != 0.0) S.emplace_back(state[s].S.begin(), state[s].S.end());
    memory.finish_step(viscosity, player_.step_s(f), S);
}

// Gradient of obstacles, loads, tools, pressure and inertia (3N, held nodes included).
void GradientChange::gradient_of_rest(const ExternalActions& actions, std::size_t frame, VectorXd& g) const {
    const Scene& scene = player_.scene();
    const double* x = base_.x[frame].data();
    double energy = 0.0;
    g.setZero(actions.force_n.size());
    if (scene.has_pressure()) scene.add_pressure_force(x, g.data());
    g = -(g + actions.force_n).eval();
    scene.obstacles.add_gradient(x, g.data(), &energy, 1, 1);
    for (std::size_t k = 0; k < scene.parts.tools.size(); ++k) {
        const auto& tool = scene.parts.tools[k];
        const Vector3d target = actions.tool_position_m.col(static_cast<Eigen::Index>(k));
        if (target.allFinite())
            g.segment<3>(3 * tool.node) +=
                tool.stiffness_n_per_m * (Eigen::Map<const Vector3d>(x + 3 * tool.node) - target);
    }
    if (scene.dynamic)  // M (a + r_M v)
        for (Eigen::Index i = 0; i < scene.parts.node_mass_kg.size(); ++i)
            g.segment<3>(3 * i) +=
                scene.parts.node_mass_kg(i) *
                (base_.a[frame].segment<3>(3 * i) + scene.rayleigh_mass_1_s * base_.v[frame].segment<3>(3 * i));
}

// dg = g(x; scene as it is now) - g(x; base). Points of the body whose coefficients are the base's are not
// touched:
//     P = F ( s (1 + b psi) S_e + S0 )
void GradientChange::change_of_gradient(const Hypothesis& h, const ExternalActions& actions, std::size_t frame,
                                        const Coefficients& base, VectorXd& dg) const {
    const Scene& scene = player_.scene();
    gradient_of_rest(actions, frame, dg);
    dg -= base.g_rest;
    const bool same_theta = std::equal(h.theta.begin(), h.theta.end(), base_.at.theta.begin(), base_.at.theta.end());
    if (scene.ties_touched || base.ties_touched || !same_theta) {
        double energy = 0.0;
        dg -= base.g_ties;
        add_tether_gradient(scene.parts.tethers, h.theta.data(), base_.x[frame].data(), dg.data(), &energy, 1, 1);
    }
    if (!scene.body_touched && !base.body_touched) return;
    const auto& sets = scene.parts.body.points();
    for (std::size_t s = 0; s < sets.size(); ++s) {
        const StrainPoints& now = sets[s];
        const BaseTrajectory::BodyState& state = base_.stresses_at(frame, scene.parts.body)[s];
        const auto &scale = base.scale[s], &prestress = base.prestress[s];
        const double mu = now.part.shear * scene.parts.body.material().mu();
        const double b_now = now.stiffening != 0.0 ? now.stiffening / mu : 0.0,
                     b_was = base.stiffening[s] != 0.0 ? base.stiffening[s] / mu : 0.0;
        const bool past = !now.prestress.empty() || !prestress.empty(), same_law = b_now == b_was && !past;
        for (std::size_t q = 0; q < now.size(); ++q) {
            if (same_law && q % kLookedAtTogether == 0) {
                const std::size_t count = std::min(kLookedAtTogether, now.size() - q);
                if (std::memcmp(&now.stiffness_scale[q], &scale[q], count * sizeof(double)) == 0) {
                    q += count - 1;
                    continue;
                }
            }
            const double psi = state.psi[q];
            const double c = now.stiffness_scale[q] * (1.0 + b_now * psi) - scale[q] * (1.0 + b_was * psi);
            if (c == 0.0 && !past) continue;
            double S[6];
            for (std::size_t i = 0; i < 6; ++i) {
                S[i] = c * state.S[6 * q + i];
                if (!now.prestress.empty()) S[i] += now.prestress[6 * q + i];
                if (!prestress.empty()) S[i] -= prestress[6 * q + i];
            }
            if (std::all_of(std::begin(S), std::end(S), [](double stress) { return stress == 0.0; })) continue;
            Matrix3d S2;
            S2 << S[0], S[3], S[4], S[3], S[1], S[5], S[4], S[5], S[2];
            const Matrix3d F = Eigen::Map<const Eigen::Matrix3f>(&state.F[9 * q]).cast<double>();
            const Matrix3d P = now.volume[q] * F * S2;
            for (auto i = static_cast<std::size_t>(now.offset[q]); i < static_cast<std::size_t>(now.offset[q + 1]); ++i)
                dg.segment<3>(3 * now.node[i]) += P * Eigen::Map<const Vector3d>(&now.gradient[3 * i]);
        }
    }
}

// Frame by frame, the change of the gradient at the base trajectory when its hypothesis gives way to each other one.
void GradientChange::visit(const std::vector<HypothesisPoint>& others, const Visitor& seen) const {
    Scene& scene = player_.scene();
    const Hypothesis h = base_.at.hypothesis();
    ViscousMemory base_memory;
    std::vector<ViscousMemory> memory(others.size());
    std::vector<char> own(others.size(), 0);  // whose viscosity is not the base's; at the first frame all are at rest
    Coefficients base;
    ExternalActions actions;
    VectorXd dg;
    for (std::size_t f = 0; f < base_.num_played; ++f) {
        enter_frame(h, f, base_memory, actions);
        const std::vector<ViscousBranch> viscosity = scene.viscosity;
        base.body_touched = scene.body_touched;
        base.ties_touched = scene.ties_touched;
        base.scale.clear();
        base.prestress.clear();
        base.stiffening.clear();
        for (const auto& set : scene.parts.body.points()) {
            base.scale.push_back(set.stiffness_scale);
            base.prestress.push_back(set.prestress);
            base.stiffening.push_back(set.stiffening);
        }
        base.rayleigh_mass_1_s = scene.rayleigh_mass_1_s;
        base.rayleigh_stiffness_s = 0.0;
        for (const auto& branch : scene.viscosity)
            if (branch.time_constant_s == 0.0) base.rayleigh_stiffness_s += branch.strength;
        gradient_of_rest(actions, f, base.g_rest);
        double energy = 0.0;
        base.g_ties.setZero(base.g_rest.size());
        add_tether_gradient(scene.parts.tethers, h.theta.data(), base_.x[f].data(), base.g_ties.data(), &energy, 1, 1);
        for (std::size_t k = 0; k < others.size(); ++k) {
            enter_frame(others[k].hypothesis(), f, own[k] ? memory[k] : base_memory, actions);
            if (f == 0 && scene.viscosity != viscosity) own[k] = true;
            if (own[k]) leave_frame(f, scene.viscosity, memory[k]);
            change_of_gradient(others[k].hypothesis(), actions, f, base, dg);
            seen(f, k, base, dg);
        }
        leave_frame(f, viscosity, base_memory);
    }
}

}  // namespace teres
