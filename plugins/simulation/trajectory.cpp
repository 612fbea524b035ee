#include "plugins/simulation/trajectory.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <future>
#include <limits>
#include <numeric>
#include <utility>

#include "core/check.h"
#include "plugins/simulation/cholesky.h"
#include "plugins/simulation/frame_choice.h"
#include "plugins/simulation/marker_rows.h"

namespace teres {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr double kDerivativeStep = 1e-3;     // of the way to the other hypothesis
constexpr Eigen::Index kModes = 24;          // of a dynamic case
constexpr std::size_t kCompliances = 8;      // frames at which the tangent is factorised
constexpr Eigen::Index kProperMotions = 16;  // of a dynamic trajectory
constexpr std::size_t kStaticFrames = 4;     // at which a change is followed statically
constexpr double kNoMotion = 1e-12;          // m
constexpr std::size_t kSolvedShare = 3;      // approximate(): one in so many frames is solved
constexpr std::size_t kFewFrames = 24;       // ... of more than these
constexpr double kFirstShift = 1e-8;         // of the mean diagonal of an indefinite tangent
constexpr std::size_t kFewShared = 8;        // frames that are not worth another thread

}  // namespace

Result<std::unique_ptr<Trajectory>> Trajectory::make(const Case& c, const PlayerSettings& settings) {
    std::unique_ptr<Trajectory> t(new Trajectory());
    TERES_TRY_ASSIGN(t->player_, ScenePlayer::make(c, settings));
    t->effects_ = make_effects(t->player_->scene());
    t->case_ = c;
    t->settings_ = settings;
    t->variants_ = model_variants(c, settings, t->player_->scene());
    return t;
}

void Trajectory::share_with_twin(bool on) noexcept {
    share_ = on && twin() != nullptr;
}

TrajectoryModel* Trajectory::twin() noexcept {
    if (!twin_) {
        auto made = make(case_, settings_);
        if (!made) return nullptr;  // this one was made of the same
        twin_ = std::move(*made);
    }
    return twin_.get();
}

void Trajectory::effect_candidate(std::size_t effect, std::size_t candidate, std::span<double> values) const noexcept {
    const auto& from = effects_[effect]->description().candidates[candidate];
    TERES_CHECK(values.size() == from.size());
    std::copy(from.begin(), from.end(), values.begin());
}

bool Trajectory::ligament_shares(std::span<double> of_node) const noexcept {
    const CaseModel& model = player_->model();
    TERES_CHECK(of_node.size() == model.num_nodes());
    std::fill(of_node.begin(), of_node.end(), 0.0);
    double total = 0.0;
    for (const Tether& t : model.ligament().tethers) {
        const double stiffness = t.share * model.parameter(static_cast<std::size_t>(t.parameter)).prior_median;
        of_node[static_cast<std::size_t>(t.node)] += stiffness;
        total += stiffness;
    }
    if (!(total > 0.0)) return false;
    for (double& share : of_node) share /= total;
    return true;
}

void Trajectory::settle_effect(std::size_t effect, std::span<double> values) const noexcept {
    const auto centre = effects_[effect]->description().surface_centre;
    if (!centre) return;
    const auto at = values.subspan(*centre, 3);
    if (!std::isfinite(at[0] + at[1] + at[2])) return;  // a step that failed: whoever made it sees it
    const Point on = player_->scene().surface.closest({at[0], at[1], at[2]}).position_m;
    std::copy(on.begin(), on.end(), at.begin());
}

NominalParameter Trajectory::parameter(std::size_t index) const noexcept {
    const ForwardParameter p = player_->model().parameter(index);
    return {p.name, p.unit, std::log(p.prior_median), p.prior_log_stdev, p.lower, p.upper};
}

void Trajectory::rest_positions(std::span<double> x_m) const noexcept {
    const auto& X = player_->model().mesh().X;
    TERES_CHECK(x_m.size() == static_cast<std::size_t>(X.size()));
    std::copy_n(X.data(), X.size(), x_m.begin());
}

void Trajectory::surface_triangles(std::span<std::int32_t> node) const noexcept {
    const auto& surface = player_->model().mesh().surface;
    TERES_CHECK(node.size() == 3 * surface.size());
    for (std::size_t t = 0; t < surface.size(); ++t) std::copy_n(surface[t].begin(), 3, node.begin() + 3 * t);
}

TrajectoryReport Trajectory::simulate(const Hypothesis& h, std::span<double> markers_m, std::span<double> points_m,
                                      std::span<double> nodes_m) noexcept {
    whole_ = std::make_shared<BaseTrajectory>();
    const TrajectoryReport report = play_all(h, markers_m, points_m, nodes_m, nullptr);
    const std::optional<Crack> crack = how_parted(h);
    return crack ? both(report, play_parted(h, *crack, markers_m, points_m, nodes_m)) : report;
}

std::optional<Crack> Trajectory::how_parted(const Hypothesis& h) const {
    return dynamic() ? std::nullopt : crack_of(effects_, h);
}

// Where the parted body is after play_all(), which left the whole one's positions in base_.
TrajectoryReport Trajectory::play_parted(const Hypothesis& h, const Crack& crack, std::span<double> markers_m,
                                         std::span<double> points_m, std::span<double> nodes_m) {
    const std::size_t first = first_parted(player_->times(), crack), F = num_frames();
    if (first == F) return {};
    PartedBody* parted = parted_.by(case_, settings_, crack);
    if (parted == nullptr) return none_of(F - first);
    std::vector<std::int32_t> frames(F - first);
    std::iota(frames.begin(), frames.end(), static_cast<std::int32_t>(first));
    std::vector<double> unseen(markers_m.empty() ? frames.size() * 3 * num_markers() : 0);
    const auto later = [&](std::span<double> all) { return all.subspan(all.size() / F * first); };
    return parted->play(h, effects_, frames, base_->x, markers_m.empty() ? std::span(unseen) : later(markers_m),
                        later(points_m), later(nodes_m), false);
}

// Every frame; the trajectory becomes the base.
TrajectoryReport Trajectory::play_all(const Hypothesis& h, std::span<double> markers_m, std::span<double> points_m,
                                      std::span<double> nodes_m, SubspaceSolver* subspace) {
    CaseModel& model = player_->model();
    const std::size_t dofs = 3 * model.num_nodes(), markers = 3 * num_markers(), points = 3 * num_points(),
                      corners = 3 * num_nodes(), state = model.num_state();
    const std::shared_ptr<const BaseTrajectory> before = base_;
    base_ = std::make_shared<BaseTrajectory>(h);

    std::vector<std::int32_t> frames(num_frames());
    std::iota(frames.begin(), frames.end(), 0);
    base_->x.assign(num_frames(), {});
    base_->num_played = horizon_ > 0 ? std::min(horizon_, num_frames()) : num_frames();
    const auto keep = [&](std::size_t f, const double* x) {
        base_->x[f] = Eigen::Map<const VectorXd>(x, static_cast<Eigen::Index>(dofs));
    };
    TrajectoryReport report;
    if (player_->scene().dynamic)
        report = player_->play(h, effects_, {}, keep, {}, horizon_, subspace);
    else
        report = play_frames(h, frames, before->x, keep);
    std::vector<double> whole(state, 0.0);
    for (std::size_t f = 0; f < num_frames(); ++f) {
        if (base_->x[f].size() == 0) base_->x[f] = f > 0 ? base_->x[f - 1] : player_->model().mesh().X.reshaped();
        std::copy_n(base_->x[f].data(), dofs, whole.begin());
        if (!markers_m.empty()) model.observe(whole, markers_m.subspan(f * markers, markers), 1);
        if (!points_m.empty()) model.predict_points(whole, points_m.subspan(f * points, points));
        if (!nodes_m.empty()) std::copy_n(whole.data(), corners, &nodes_m[f * corners]);
    }
    if (player_->scene().dynamic) base_->differentiate([&](std::size_t f) { return player_->step_s(f); });
    guide_ = base_;
    return report;
}

// Each frame is an equilibrium of its own unless the body has memory: the twin solves the later half meanwhile, from
// where it was in `before`.
TrajectoryReport Trajectory::play_frames(const Hypothesis& h, std::span<const std::int32_t> frames,
                                         const std::vector<VectorXd>& before, const ScenePlayer::Visitor& visit) {
    const auto dofs = static_cast<Eigen::Index>(3 * player_->model().num_nodes());
    const std::size_t half = (frames.size() + 1) / 2;
    const auto earlier = frames.first(half), later = frames.subspan(half);
    VectorXd last;  // where the earlier half ends
    // Starts at rest or `from`, where the body was at `from_frame`; from frame to frame it moves as it did `before` and
    // goes on leaving that as it last did.
    const auto play = [&](Trajectory& by, std::span<const std::int32_t> part, const VectorXd* from,
                          std::int32_t from_frame) {
        std::size_t k = 0;
        VectorXd away, away_before;  // from `before`, at the last frame and the one before that
        const auto guess = [&, part](std::size_t f, double* x) {
            Eigen::Map<VectorXd> at(x, dofs);
            if (k == 0 && from != nullptr) at = *from;
            const std::int32_t f0 = k == 0 ? from_frame : part[k - 1];
            const bool compared = f0 >= 0 && f < before.size();
            std::swap(away, away_before);
            away = at;
            if (compared) away -= before[static_cast<std::size_t>(f0)];
            if (k > 1)
                at += (static_cast<double>(f) - f0) / static_cast<double>(f0 - part[k - 2]) * (away - away_before);
            if (compared) at += before[f] - before[static_cast<std::size_t>(f0)];
            ++k;
        };
        const auto seen = [&](std::size_t f, const double* x) {
            if (static_cast<std::int32_t>(f) == earlier.back()) last = Eigen::Map<const VectorXd>(x, dofs);
            visit(f, x);
        };
        return by.player_->play(h, by.effects_, part, seen, guess);
    };
    ExternalActions actions;
    player_->enter(time_s(0), h, effects_, actions);
    const bool memory = !player_->scene().viscosity.empty();
    if (!share_ || memory || before.size() != num_frames() || frames.size() < kFewShared)
        return play(*this, frames, nullptr, -1);
    auto twins = std::async(std::launch::async, [&] {
        return play(*twin_, later, &before[static_cast<std::size_t>(later.front())], later.front());
    });
    const TrajectoryReport report = play(*this, earlier, nullptr, -1);
    TrajectoryReport rest = twins.get();
    if (rest.frames_converged < rest.frames && report.frames_converged == report.frames)  // too far: in order
        rest = play(*this, later, &last, earlier.back());
    return both(report, rest);
}

// z_f(h) = z_f + (1 + a_f) dz_f + r_f about the last whole trajectory: dz first order at every frame; a and the rest r
// known where frames are solved, interpolated between them. Nodes between them move as when every frame was solved, and
// away from there as interpolated: good enough for the derivatives of first_order().
TrajectoryReport Trajectory::approximate(const Hypothesis& h, std::span<double> markers_m) noexcept {
    CaseModel& model = player_->model();
    const std::size_t dofs = 3 * model.num_nodes(), F = num_frames();
    const auto rows = static_cast<Eigen::Index>(3 * num_markers()), frames = static_cast<Eigen::Index>(F);
    if (player_->scene().dynamic) return move_in_subspace(h, markers_m);
    if (F <= kFewFrames || how_parted(h) || (base_->x.empty() && whole_->x.empty()))
        return simulate(h, markers_m, {}, {});
    const std::shared_ptr<const BaseTrajectory> before = base_;
    if (!whole_->x.empty()) base_ = std::exchange(whole_, std::make_shared<BaseTrajectory>());
    MatrixXd change(rows, frames);
    const bool predicted = first_order({&h, 1}, {change.data(), static_cast<std::size_t>(change.size())}, {});
    ExternalActions actions;
    player_->enter(time_s(0), h, effects_, actions);
    const bool memory = !player_->scene().viscosity.empty();
    if (!predicted || memory) return simulate(h, markers_m, {}, {});
    whole_ = std::exchange(base_, std::make_shared<BaseTrajectory>());
    base_ = std::make_shared<BaseTrajectory>(h);
    base_->num_played = F;
    // Tangents stay those of solved frames: one between them is not in equilibrium and may be near singular.
    base_->compliance = whole_->compliance;
    base_->nearest = whole_->nearest;
    base_->with_markers = true;

    const std::vector<std::int32_t> solved = frames_to_solve(change, F / kSolvedShare);
    MatrixXd node_change = MatrixXd::Zero(static_cast<Eigen::Index>(dofs), static_cast<Eigen::Index>(solved.size())),
             rest = MatrixXd::Zero(rows, node_change.cols());  // zero where a trajectory is given up
    std::vector<double> whole(model.num_state(), 0.0);
    const auto markers = [&](const double* x) {
        VectorXd z(rows);
        std::copy_n(x, dofs, whole.begin());
        model.observe(whole, {z.data(), static_cast<std::size_t>(rows)}, 1);
        return z;
    };
    const auto slot = [&](std::size_t f) {
        return std::lower_bound(solved.begin(), solved.end(), static_cast<std::int32_t>(f)) - solved.begin();
    };
    std::vector<char> reached(solved.size(), 0);
    const TrajectoryReport report = play_frames(h, solved, before->x, [&](std::size_t f, const double* x) {
        node_change.col(slot(f)) = Eigen::Map<const VectorXd>(x, node_change.rows()) - guide_->x[f];
        reached[static_cast<std::size_t>(slot(f))] = 1;
    });
    const auto markers_of_whole = [&](Eigen::Index f) -> VectorXd {
        const VectorXd z = markers(whole_->x[static_cast<std::size_t>(f)].data());
        return whole_->marker_rest_m.size() > 0 ? VectorXd(z + whole_->marker_rest_m.col(f)) : z;
    };
    for (Eigen::Index k = 0; k < rest.cols(); ++k) {
        const std::int32_t f = solved[static_cast<std::size_t>(k)];
        if (!reached[static_cast<std::size_t>(k)]) {
            node_change.col(k) = whole_->x[static_cast<std::size_t>(f)] - guide_->x[static_cast<std::size_t>(f)];
            continue;
        }
        const VectorXd x = guide_->x[static_cast<std::size_t>(f)] + node_change.col(k);
        rest.col(k) = markers(x.data()) - markers_of_whole(f) - change.col(f);
        base_->solved.push_back(f);
    }
    change = with_rest(change, rest, solved);
    const MatrixXd nodes = interpolate(node_change, solved, frames);
    base_->marker_rest_m.resize(rows, frames);
    for (Eigen::Index f = 0; f < frames; ++f) {
        base_->x.push_back(guide_->x[static_cast<std::size_t>(f)] + nodes.col(f));
        const VectorXd z = markers_of_whole(f) + change.col(f);
        Eigen::Map<VectorXd>(markers_m.data() + f * rows, rows) = z;
        base_->marker_rest_m.col(f) = z - markers(base_->x.back().data());
    }
    return report;
}

void Trajectory::rebase() noexcept {
    if (whole_->x.empty() || base_->solved.empty()) return;
    whole_ = std::make_shared<BaseTrajectory>();
    base_->with_markers = base_->with_points = false;  // tangents of its own, made on first use
}

// Columns whose span the motion under `h` hardly leaves: what the last whole trajectory did, modes, and what the change
// to `h` does statically to it.
MatrixXd Trajectory::motions_under(const Hypothesis& h) const {
    const auto& pattern = player_->model().system().pattern();
    const auto dofs = static_cast<Eigen::Index>(3 * player_->model().num_nodes());
    const auto all_nodes = [&](const MatrixXd& free) {
        MatrixXd out = MatrixXd::Zero(dofs, free.cols());
        for (Eigen::Index i = 0; i < dofs / 3; ++i)
            if (const auto row = pattern.free_index(static_cast<NodeIndex>(i)); row >= 0)
                out.middleRows<3>(3 * i) = free.middleRows<3>(3 * static_cast<Eigen::Index>(row));
        return out;
    };
    const std::size_t F = base_->num_played;
    MatrixXd moved(dofs, static_cast<Eigen::Index>(F));
    for (std::size_t f = 0; f < F; ++f) moved.col(static_cast<Eigen::Index>(f)) = base_->x[f] - base_->x[0];
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(moved.transpose() * moved);
    const Eigen::Index kept = std::min<Eigen::Index>(kProperMotions, moved.cols());
    const MatrixXd proper = moved * eigen.eigenvectors().rightCols(kept);

    const std::size_t every = std::max<std::size_t>(1, F / kStaticFrames);
    MatrixXd statics = MatrixXd::Zero(pattern.num_rows(), static_cast<Eigen::Index>((F + every - 1) / every));
    about_base().visit(
        {point_between(base_->at, h, 1.0, effects_)},
        [&](std::size_t f, std::size_t, const GradientChange::Coefficients&, const VectorXd& dg) {
            if (f % every != 0) return;
            for (Eigen::Index i = 0; i < dg.size() / 3; ++i)
                if (const auto row = pattern.free_index(static_cast<NodeIndex>(i)); row >= 0)
                    statics.col(static_cast<Eigen::Index>(f / every)).segment<3>(3 * static_cast<Eigen::Index>(row)) =
                        dg.segment<3>(3 * i);
        });
    base_->tangent->solve(statics);

    const MatrixXd modes = all_nodes(base_->modal->modes()), changes = all_nodes(statics);
    MatrixXd out(dofs, proper.cols() + modes.cols() + changes.cols());
    Eigen::Index used = 0;
    for (const MatrixXd* part : {&proper, &modes, &changes})
        for (Eigen::Index k = 0; k < part->cols(); ++k)
            if (part->col(k).norm() > kNoMotion) out.col(used++) = part->col(k);
    return out.leftCols(used);
}

// approximate() of a dynamic case: forces of the whole mesh, motion in a subspace about the last whole trajectory.
TrajectoryReport Trajectory::move_in_subspace(const Hypothesis& h, std::span<double> markers_m) {
    if (base_->x.empty() && whole_->x.empty()) return simulate(h, markers_m, {}, {});
    if (!whole_->x.empty()) base_ = std::exchange(whole_, std::make_shared<BaseTrajectory>());
    if (!base_->with_markers) prepare_compliances(false);
    if (!base_->modal) return simulate(h, markers_m, {}, {});
    SubspaceSolver subspace(player_->model().system(), player_->settings().model.equilibrium, motions_under(h));
    whole_ = std::exchange(base_, std::make_shared<BaseTrajectory>());
    return play_all(h, markers_m, {}, {}, &subspace);
}

// Tangent of the scene as it is now; a diagonal shift where it is indefinite.
bool Trajectory::factorise(const Hypothesis& h, const ExternalActions& actions, const VectorXd& x,
                           Cholesky& factor) const {
    const MechanicalSystem& system = player_->model().system();
    std::vector<double> values;
    const Positions positions = Eigen::Map<const Positions>(x.data(), 3, x.size() / 3);
    if (!system.tangent(actions, {}, 0, h.theta.data(), positions, values)) return false;
    int tries = 0;
    return factor.factorise_shifted(values, tries, kFirstShift);
}

// Of the scene as it is now, at x.
void Trajectory::prepare_compliance(const ExternalActions& actions, const VectorXd& x, bool points,
                                    BaseTrajectory::Compliance& out) const {
    if (!factor_) factor_ = std::make_unique<Cholesky>(player_->model().system().pattern());
    if (!factorise(base_->at.hypothesis(), actions, x, *factor_)) return;
    const auto rows = [&](MatrixXd Ht) -> Eigen::MatrixXf {
        factor_->solve(Ht);
        return Ht.transpose().cast<float>();
    };
    if (!base_->with_markers) out.markers = rows(marker_rows(player_->model(), x.data()));
    if (points) out.points = rows(point_rows(player_->model()));
}

// Every `stride`-th of the knots of a quasi-static base.
void Trajectory::prepare_compliances_at(const std::vector<std::size_t>& knots, std::size_t first, std::size_t stride,
                                        bool points) const {
    ExternalActions actions;
    ViscousMemory memory;
    const GradientChange changes = about_base();
    for (std::size_t f = 0; f < base_->x.size(); ++f) {
        changes.enter_frame(base_->at.hypothesis(), f, memory, actions);
        for (std::size_t k = first; k < knots.size(); k += stride)
            if (knots[k] == f) prepare_compliance(actions, base_->x[f], points, base_->compliance[k]);
        changes.leave_frame(f, player_->scene().viscosity, memory);
    }
}

// Runs `theirs` on the twin, about the base of this one, beside `ours`.
template <class Theirs, class Ours>
void Trajectory::beside_twin(const Theirs& theirs, const Ours& ours) const {
    const std::shared_ptr<BaseTrajectory> twins_base = std::exchange(twin_->base_, base_);
    auto other = std::async(std::launch::async, [&] { theirs(*twin_); });
    ours();
    other.get();
    twin_->base_ = twins_base;
}

void Trajectory::prepare_compliances(bool points) const {
    if (player_->scene().dynamic) {
        if (!prepare_modes(points)) return;
    } else {
        const std::vector<std::size_t> knots = distinct_frames(base_->x, base_->solved, kCompliances, base_->nearest);
        base_->compliance.resize(knots.size());
        if (share_)
            beside_twin([&](Trajectory& twin) { twin.prepare_compliances_at(knots, 1, 2, points); },
                        [&] { prepare_compliances_at(knots, 0, 2, points); });
        else
            prepare_compliances_at(knots, 0, 1, points);
    }
    base_->with_markers = true;
    base_->with_points = base_->with_points || points;
}

// Makes of the base what first-order responses need; false if its tangent cannot be factorised.
bool Trajectory::can_respond(bool points) const {
    if (!base_->with_markers || (points && !base_->with_points)) prepare_compliances(points);
    return std::none_of(base_->compliance.begin(), base_->compliance.end(),
                        [](const auto& c) { return c.markers.size() == 0; });
}

// A dynamic base: one compliance next to its mean state, and the modes there.
bool Trajectory::prepare_modes(bool points) const {
    Scene& scene = player_->scene();
    const auto& pattern = player_->model().system().pattern();
    const std::span<const VectorXd> played = std::span(base_->x).first(base_->num_played);
    VectorXd mean = VectorXd::Zero(played.front().size());
    for (const VectorXd& x : played) mean += x / static_cast<double>(played.size());
    // A mean of turned shapes is compressed and may buckle: the frame next to it does not.
    const VectorXd& middle = *std::min_element(played.begin(), played.end(), [&](const VectorXd& a, const VectorXd& b) {
        return (a - mean).squaredNorm() < (b - mean).squaredNorm();
    });
    base_->nearest.assign(base_->x.size(), 0);
    base_->compliance.resize(1);
    ExternalActions actions;
    player_->enter(time_s(played.size() - 1), base_->at.hypothesis(), effects_, actions);  // without memory
    prepare_compliance(actions, middle, points, base_->compliance.front());
    if (!factor_->factorised()) return false;
    VectorXd mass(pattern.num_rows());
    for (Eigen::Index i = 0; i < scene.parts.node_mass_kg.size(); ++i)
        if (const auto node = pattern.free_index(static_cast<NodeIndex>(i)); node >= 0)
            mass.segment<3>(3 * node).setConstant(scene.parts.node_mass_kg(i));
    base_->modal = std::make_unique<ModalResponse>(*factor_, mass, kModes, modal_subspace_);
    base_->modal_markers = marker_rows(player_->model(), middle.data()).transpose() * base_->modal->modes();
    base_->modal_points = point_rows(player_->model()).transpose() * base_->modal->modes();
    base_->tangent = std::make_unique<Cholesky>(*factor_);
    return true;
}

bool Trajectory::first_order(std::span<const Hypothesis> others, std::span<double> markers_m,
                             std::span<double> points_m) noexcept {
    if (base_->x.empty()) return false;
    if (share_ && others.size() > 1 && points_m.empty()) {
        if (!can_respond(false)) return false;  // what both need
        const std::size_t mine = others.size() / 2, rows = mine * 3 * num_markers() * num_frames();
        bool ours = false, theirs = false;
        share_ = false;
        beside_twin([&](Trajectory& t) { theirs = t.first_order(others.subspan(mine), markers_m.subspan(rows), {}); },
                    [&] { ours = first_order(others.first(mine), markers_m.first(rows), {}); });
        share_ = true;
        return ours && theirs;
    }
    const std::size_t F = num_frames(), M = 3 * num_markers(), P = 3 * num_points();
    const bool with_points = !points_m.empty();
    TERES_CHECK(markers_m.size() == others.size() * F * M);
    TERES_CHECK(!with_points || points_m.size() == others.size() * F * P);
    if (!can_respond(with_points)) return false;
    Scene& scene = player_->scene();

    std::vector<HypothesisPoint> points;
    for (const Hypothesis& other : others) points.push_back(point_between(base_->at, other, kDerivativeStep, effects_));
    std::vector<ModalResponse::State> motion(others.size());
    std::fill(markers_m.begin(), markers_m.end(), 0.0);
    std::fill(points_m.begin(), points_m.end(), 0.0);
    const auto& pattern = player_->model().system().pattern();
    VectorXd force = VectorXd::Zero(pattern.num_rows()), dz, dp;
    about_base().visit(
        points, [&](std::size_t f, std::size_t k, const GradientChange::Coefficients& base, const VectorXd& dg) {
            const BaseTrajectory::Compliance& C = base_->compliance[base_->nearest[f]];
            dz.setZero(static_cast<Eigen::Index>(M));
            dp.setZero(static_cast<Eigen::Index>(with_points ? P : 0));
            force.setZero();
            for (Eigen::Index i = 0; i < dg.size() / 3; ++i) {
                const auto node = pattern.free_index(static_cast<NodeIndex>(i));
                if (node < 0 || dg.segment<3>(3 * i).isZero(0.0)) continue;
                force.segment<3>(3 * node) = dg.segment<3>(3 * i) / -kDerivativeStep;
                const Eigen::Vector3f part = force.segment<3>(3 * node).cast<float>();
                dz += (C.markers.middleCols<3>(3 * node) * part).cast<double>();
                if (with_points) dp += (C.points.middleCols<3>(3 * node) * part).cast<double>();
            }
            if (scene.dynamic) {
                const VectorXd modal = base_->modal->modes().transpose() * force;
                base_->modal->advance(motion[k], modal, player_->step_s(f), base.rayleigh_mass_1_s,
                                      base.rayleigh_stiffness_s);
                const VectorXd beyond = motion[k].q - modal.cwiseQuotient(base_->modal->omega().cwiseAbs2());
                dz += base_->modal_markers * beyond;
                if (with_points) dp += base_->modal_points * beyond;
                if (f == 0) dz.setZero(), dp.setZero();  // released as it lies
            }
            std::copy_n(dz.data(), M, &markers_m[(k * F + f) * M]);
            if (with_points) std::copy_n(dp.data(), P, &points_m[(k * F + f) * P]);
        });
    return true;
}

bool Trajectory::marker_compliance(std::int32_t node, std::span<double> out) const noexcept {
    const std::size_t M = 3 * num_markers();
    TERES_CHECK(out.size() == num_frames() * M * 3);
    if (base_->x.empty() || player_->scene().dynamic || node < 0 || static_cast<std::size_t>(node) >= num_nodes())
        return false;
    if (!can_respond(false)) return false;
    const auto row = 3 * static_cast<Eigen::Index>(player_->model().system().pattern().free_index(node));
    for (std::size_t f = 0; f < num_frames(); ++f)
        for (std::size_t r = 0; r < M; ++r)
            for (std::size_t b = 0; b < 3; ++b)
                out[(f * M + r) * 3 + b] = row < 0
                                               ? 0.0
                                               : base_->compliance[base_->nearest[f]].markers(
                                                     static_cast<Eigen::Index>(r), row + static_cast<Eigen::Index>(b));
    return true;
}

bool Trajectory::effect_forces(std::size_t which, std::span<double> rms_n) const noexcept {
    TERES_CHECK(rms_n.size() == num_nodes());
    if (base_->x.empty() || which >= base_->at.effects.size()) return false;
    const EffectInstance& on = base_->at.effects[which];
    const auto crack = effects_[static_cast<std::size_t>(on.index)]->crack(on.values);
    if (crack && !dynamic()) {
        const auto parted = part(case_.mesh, *crack);
        if (!parted) return false;
        std::copy(parted->opened_m2.begin(), parted->opened_m2.end(), rms_n.begin());
        return true;
    }
    HypothesisPoint without{base_->at.theta, base_->at.values, {}};
    without.values.erase(without.values.begin() + static_cast<std::ptrdiff_t>(which));
    for (std::size_t k = 0, v = 0; k < base_->at.effects.size(); ++k)
        if (k != which) without.effects.push_back({base_->at.effects[k].index, without.values[v++]});
    std::fill(rms_n.begin(), rms_n.end(), 0.0);
    about_base().visit({without},
                       [&](std::size_t, std::size_t, const GradientChange::Coefficients&, const VectorXd& dg) {
                           for (std::size_t i = 0; i < rms_n.size(); ++i)
                               rms_n[i] += dg.segment<3>(3 * static_cast<Eigen::Index>(i)).squaredNorm();
                       });
    for (double& f : rms_n) f = std::sqrt(f / static_cast<double>(num_frames()));
    return true;
}

// Where the body was at all frames at the last trajectory, if it was at all.
std::span<const VectorXd> Trajectory::whole_positions() const {
    return base_->x.size() == num_frames() ? std::span<const VectorXd>(base_->x) : std::span<const VectorXd>();
}

TrajectoryReport Trajectory::simulate_variant(std::size_t index, const Hypothesis& h,
                                              std::span<const std::int32_t> frames, std::span<double> markers_m,
                                              std::span<double> points_m) noexcept {
    const ModelVariant& variant = variants_[index];
    const auto whole = [&](auto some, auto markers, auto points) {
        return play_variant(variant, case_, settings_, h, some, whole_positions(), markers, points);
    };
    const std::optional<Crack> crack = how_parted(h);
    if (!crack) return whole(frames, markers_m, points_m);
    const auto parted = [&](auto some, auto markers, auto points) {
        const auto body = PartedBody::make(case_, settings_, *crack);  // others may ask at once: parted_ stays
        if (body != nullptr)
            return play_variant(variant, body->data(), settings_, h, some, body->doubled(whole_positions()), markers,
                                points);
        for (const auto& out : {markers, points})
            std::fill(out.begin(), out.end(), std::numeric_limits<double>::quiet_NaN());
        return none_of(some.size());
    };
    return play_in_two(frames, first_parted(player_->times(), *crack), markers_m, points_m, whole, parted);
}

TrajectoryReport Trajectory::simulate_at(const Hypothesis& h, std::span<const std::int32_t> frames,
                                         std::span<double> markers_m) noexcept {
    const auto whole = [&](auto some, auto markers, auto) {
        return player_->play_markers(h, effects_, some, markers, {}, {}, !dynamic());
    };
    const std::optional<Crack> crack = how_parted(h);
    if (!crack) return whole(frames, markers_m, 0);
    const auto parted = [&](auto some, auto markers, auto) {
        PartedBody* body = parted_.by(case_, settings_, *crack);
        if (body == nullptr) return none_of(some.size());
        return body->play(h, effects_, some, whole_positions(), markers, {}, {}, true);
    };
    return play_in_two(frames, first_parted(player_->times(), *crack), markers_m, {}, whole, parted);
}

}  // namespace teres
