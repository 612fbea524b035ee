#include "plugins/simulation/scene_player.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/case/frame_times.h"
#include "core/check.h"

namespace teres {

using Eigen::Vector3d;

namespace {

constexpr double kClampLayer = 1e-4;      // thickness of the layer that stands for a rigid clamp, over the body's size
constexpr int kFollowerRounds = 24;       // a pressure follows the surface in rounds ...
constexpr double kFollowerChange = 1e-3;  // ... until its force changes by less than this share

// Clamped nodes become nodes on a layer of thickness h of the body's own stiffness: k = E A_i / h.
Result<double> lay_clamps_on_springs(Case& c) {
    TERES_TRY_ASSIGN(const TetMesh mesh, TetMesh::make(c.mesh));
    TERES_TRY_ASSIGN(const Material material, Material::make(c.body));
    const double size = (mesh.X.rowwise().maxCoeff() - mesh.X.rowwise().minCoeff()).norm(), layer = kClampLayer * size;
    std::vector<char> clamped(mesh.num_nodes(), 0);
    for (const auto node : c.clamped) clamped[static_cast<std::size_t>(node)] = 1;
    std::vector<double> clamped_area(mesh.num_nodes(), 0.0);  // of the clamped faces alone
    for (const auto& f : mesh.surface) {
        const Vector3d a = mesh.X.col(f[0]), b = mesh.X.col(f[1]), d = mesh.X.col(f[2]);
        bool all = true;
        for (const auto node : f) all = all && clamped[static_cast<std::size_t>(node)];
        if (all)
            for (const auto node : f) clamped_area[static_cast<std::size_t>(node)] += (b - a).cross(d - a).norm() / 6.0;
    }
    for (const auto node : c.clamped) {
        const auto i = static_cast<std::size_t>(node);
        const double area = clamped_area[i] > 0.0 ? clamped_area[i] : std::pow(mesh.node_volume[i], 2.0 / 3.0);
        SpringData spring;
        spring.node_id = node;
        spring.anchor_m = c.mesh.nodes[i];
        spring.law = SpringLaw::kRestShape;
        spring.k = {3.0 * material.mu() * area / layer, 0.0, 0.0};
        c.springs.push_back(spring);
    }
    c.clamped.clear();
    return layer;
}

}  // namespace

Result<std::unique_ptr<ScenePlayer>> ScenePlayer::make(const Case& c, const PlayerSettings& settings) {
    if (settings.model.integrator == "implicit_euler")
        return invalid_input(
            "integrator = \"implicit_euler\" damps too strongly for trajectories: take generalised_alpha");
    std::unique_ptr<ScenePlayer> p(new ScenePlayer());
    p->case_ = c;
    p->settings_ = settings;
    p->settings_.model.separate_parts = true;
    p->settings_.model.max_lanes = 1;
    // The scene changes the system between steps: nothing may read it in the background.
    p->settings_.model.equilibrium.renewal_steps = 0;
    TetherRanges ranges;
    double layer = 0.0;
    const std::size_t clamps = settings.soft_clamps ? c.clamped.size() : 0;
    if (clamps > 0) {
        TERES_TRY_ASSIGN(layer, lay_clamps_on_springs(p->case_));
    }
    Case without_damping = p->case_;  // damping is played by the scene
    without_damping.body.rayleigh_mass_1_s = without_damping.body.rayleigh_stiffness_s = 0.0;
    TERES_TRY_ASSIGN(p->model_, CaseModel::make(without_damping, p->settings_.model));
    ranges.ligament_end = p->model_->ligament().tethers.size();
    ranges.clamp_end = p->model_->system().parts().tethers.size();
    ranges.clamp_begin = ranges.clamp_end - clamps;
    p->scene_ = std::make_unique<Scene>(p->case_, *p->model_, ranges, layer);
    p->tracks_ = std::make_unique<LoadTracks>(p->case_);
    p->times_ = frame_times(p->case_);
    if (p->times_.empty()) return invalid_input(c.folder.string() + ": the recording has no frames");
    if (settings.num_frames > 0)
        p->times_.resize(std::min(p->times_.size(), static_cast<std::size_t>(settings.num_frames)));
    for (const double t : p->times_) p->frame_loads_.push_back(p->loads_at(t));
    p->batch_.assign(p->model_->num_state() * padded_lanes(1), 0.0);
    return p;
}

double ScenePlayer::step_s(std::size_t frame) const {
    if (frame > 0) return times_[frame] - times_[frame - 1];
    return case_.dt_s > 0.0 ? case_.dt_s : 1.0;
}

ScenePlayer::KnownLoads ScenePlayer::loads_at(double t_s) const {
    tool_loads_t loads;
    tracks_->at(t_s, loads);
    KnownLoads out;
    for (std::size_t r = 0; r < model_->num_regions(); ++r)
        for (const double f : {loads.fx_n[r], loads.fy_n[r], loads.fz_n[r]}) out.region_force_n.push_back(f);
    for (std::size_t k = 0; k < model_->num_tools(); ++k)
        for (const double x : {loads.x_m[k], loads.y_m[k], loads.z_m[k]}) out.tool_m.push_back(x);
    return out;
}

void ScenePlayer::enter(double t_s, const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                        ExternalActions& actions) {
    const auto frame = std::lower_bound(times_.begin(), times_.end(), t_s);
    KnownLoads between;
    const bool at_frame = frame != times_.end() && *frame == t_s;
    if (!at_frame) between = loads_at(t_s);
    enter(t_s, at_frame ? frame_loads_[static_cast<std::size_t>(frame - times_.begin())] : between, h, effects,
          actions);
}

void ScenePlayer::enter(double t_s, const KnownLoads& loads, const Hypothesis& h,
                        const std::vector<std::unique_ptr<Effect>>& effects, ExternalActions& actions) {
    scene_->reset(t_s, loads.region_force_n);
    for (std::size_t e = 0; e < effects.size(); ++e)
        for (const auto& on : h.effects)
            if (static_cast<std::size_t>(on.index) == e && !is_null(effects[e]->description(), on.values))
                effects[e]->apply(on.values, *scene_);
    model_->system().resolve(scene_->region_force_n, loads.tool_m, actions);
    actions.force_n += scene_->force_n.reshaped();
}

// The batch holds the state; a pressure is a dead load within a round and follows the surface between rounds: a fixed
// point f = F(x(f)), relaxed after Aitken (Kuettler, Wall, Comput Mech 43, 2008) as a body that hangs on little
// turns under it by more than it turned.
ScenePlayer::StepResult ScenePlayer::settle(double h, const ExternalActions& actions,
                                            const std::vector<double>& theta) {
    const std::size_t stride = padded_lanes(1), dofs = 3 * model_->num_nodes();
    const bool dynamic = scene_->dynamic;
    if (!scene_->has_pressure()) {
        const EquilibriumReport r = model_->stepper().step(actions, h, theta.data(), batch_.data(), 1);
        return {r.lanes_converged == 1, r.relative_residual};
    }
    StepResult result;
    Eigen::VectorXd x(static_cast<Eigen::Index>(dofs)), follower, change, last_change;
    const auto on_surface = [&] {
        for (std::size_t d = 0; d < dofs; ++d) x(static_cast<Eigen::Index>(d)) = batch_[d * stride];
        Eigen::VectorXd force = Eigen::VectorXd::Zero(x.size());
        scene_->add_pressure_force(x.data(), force.data());
        return force;
    };
    follower = on_surface();
    double relaxation = 1.0;
    for (int round = 0; round < kFollowerRounds; ++round) {
        ExternalActions loaded = actions;
        loaded.force_n += follower;
        const EquilibriumReport r = model_->stepper().step(loaded, h, theta.data(), batch_.data(), 1);
        result = {r.lanes_converged == 1, r.relative_residual};
        if (!result.converged || dynamic) return result;  // a time step takes the surface at its start
        last_change.swap(change);
        change = on_surface() - follower;
        if (change.norm() <= kFollowerChange * follower.norm()) return result;
        if (round > 0) {
            const Eigen::VectorXd bend = change - last_change;
            if (const double squared = bend.squaredNorm(); squared > 0.0)
                relaxation *= -last_change.dot(bend) / squared;
        }
        follower += relaxation * change;
    }
    result.converged = false;
    return result;
}

ScenePlayer::StepResult ScenePlayer::settle_from(std::span<const double> start, double h, std::span<const double> theta,
                                                 std::span<double> end) {
    const std::size_t stride = padded_lanes(1);
    std::vector<double> packed(std::max<std::size_t>(1, theta.size()) * stride, 0.0);
    for (std::size_t p = 0; p < theta.size(); ++p) std::fill_n(packed.begin() + p * stride, stride, theta[p]);
    for (std::size_t d = 0; d < start.size(); ++d) std::fill_n(batch_.begin() + d * stride, stride, start[d]);
    const StepResult result = settle(h, actions_, packed);
    for (std::size_t d = 0; d < end.size(); ++d) end[d] = batch_[d * stride];
    return result;
}

ScenePlayer::StepResult ScenePlayer::step(double from_s, double to_s, const Hypothesis& h,
                                          const std::vector<std::unique_ptr<Effect>>& effects) {
    const double length = to_s - from_s, memory_length = (1.0 - model_->stepper().alpha_f()) * length;

    enter(to_s, h, effects, actions_);
    memory_.enter_step(scene_->viscosity, scene_->dynamic ? memory_length : length, scene_->body_points());
    model_->stepper().set_rayleigh_mass(scene_->rayleigh_mass_1_s);
    StepResult result = settle_from(state_, length, h.theta, state_);
    if (!result.converged && !last_state_.empty()) {  // the guess was a bad one
        model_->solver().follow_system();
        result = settle_from(last_state_, length, h.theta, state_);
    }
    memory_.finish_step(scene_->viscosity, length, scene_->parts.body, state_.data());
    return result;
}

ScenePlayer::StepResult ScenePlayer::rest_at(double t_s, const KnownLoads& loads, const Hypothesis& h,
                                             const std::vector<std::unique_ptr<Effect>>& effects, std::span<double> x) {
    TERES_CHECK(!scene_->dynamic && x.size() == 3 * model_->num_nodes());
    enter(t_s, loads, h, effects, actions_);
    return settle_from(x, 0.0, h.theta, x);
}

TrajectoryReport ScenePlayer::play(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                                   std::span<const std::int32_t> frames, const Visitor& visit, const Guess& guess,
                                   std::size_t horizon, SubspaceSolver* subspace, bool all) {
    TERES_CHECK(h.theta.size() == model_->num_parameters());
    const std::size_t dofs = 3 * model_->num_nodes();
    const bool dynamic = scene_->dynamic;
    state_.resize(model_->num_state());
    model_->rest_state(state_);
    memory_.start();
    model_->stepper().restart();
    enter(times_.front(), h, effects, actions_);
    const bool memory = dynamic || !scene_->viscosity.empty();
    if (dynamic)  // released from rest: a = g
        for (std::size_t i = 0; i < model_->num_nodes(); ++i)
            if (!scene_->parts.held[i])
                std::copy_n(scene_->parts.gravity_m_s2.data(), 3, state_.begin() + 2 * dofs + 3 * i);

    if (dynamic && subspace != nullptr) subspace->project(state_.data() + 2 * dofs);
    model_->stepper().reduce_to(dynamic ? subspace : nullptr);

    TrajectoryReport report;
    std::size_t listed = 0, failed = 0;
    int in_a_row = 0;
    const std::size_t end = horizon > 0 ? std::min(horizon, times_.size()) : times_.size();
    const std::size_t num_wanted = frames.empty() ? end : frames.size();
    for (std::size_t f = 0; f < end && listed < num_wanted; ++f) {
        const bool wanted = frames.empty() || static_cast<std::size_t>(frames[listed]) == f;
        if (!wanted && !memory) continue;
        bool converged = true;
        if (!dynamic || f > 0) {
            last_state_.clear();
            if (!dynamic && guess) {
                last_state_ = state_;
                guess(f, state_.data());
            }
            const double length = step_s(f), to = times_[f];
            const int parts = dynamic ? parts_of_step(length, settings_.model.max_step_s) : 1;
            for (int k = 0; k < parts; ++k) {
                const StepResult r =
                    step(to - length + length * k / parts, to - length + length * (k + 1) / parts, h, effects);
                converged = converged && r.converged;
                report.relative_residual = std::max(report.relative_residual, r.relative_residual);
            }
        }
        if (!wanted) continue;
        ++listed;
        ++report.frames;
        failed += !converged;
        in_a_row = converged ? 0 : in_a_row + 1;
        if ((all && failed > 0) || in_a_row > settings_.most_failed_in_a_row ||
            static_cast<double>(failed) > 1.0 + settings_.most_failed_share * static_cast<double>(num_wanted)) {
            report.frames = static_cast<std::int32_t>(num_wanted);
            return report;
        }
        report.frames_converged += converged;
        visit(f, state_.data());
    }
    return report;
}

TrajectoryReport ScenePlayer::play_markers(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                                           std::span<const std::int32_t> frames, std::span<double> markers_m,
                                           std::span<double> points_m, const Guess& guess, bool all) {
    const std::size_t row = 3 * model_->num_markers(), dofs = 3 * model_->num_nodes(),
                      points = 3 * model_->num_points();
    TERES_CHECK(markers_m.size() == frames.size() * row);
    TERES_CHECK(points_m.empty() || points_m.size() == frames.size() * points);
    std::vector<double> whole(model_->num_state(), 0.0);
    std::size_t k = 0;
    const auto see = [&](std::size_t, const double* x) {
        std::copy_n(x, dofs, whole.begin());
        model_->observe(whole, markers_m.subspan(k * row, row), 1);
        if (!points_m.empty()) model_->predict_points(whole, points_m.subspan(k * points, points));
        ++k;
    };
    return play(h, effects, frames, see, guess, 0, nullptr, all);
}

}  // namespace teres
