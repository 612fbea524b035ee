#include "tools/peer_bench/peer_model.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>

#include "plugins/simulation/corotational.h"
#include "plugins/simulation/static_stvk.h"

namespace teres::peer {

using Eigen::Index;
using Eigen::VectorXd;

Result<PeerModel> PeerModel::make(const Scene& scene, const RunSettings& run) {
    PeerModel model;
    model.scene_ = &scene;
    model.run_ = &run;
    std::unique_ptr<ElasticTets> body;
    if (scene.law == SolidLaw::kStvk) {
        TERES_TRY_ASSIGN(StvkTets stvk, StvkTets::make(scene.mesh, scene.poissons_ratio));
        body = std::make_unique<StvkTets>(std::move(stvk));
    } else {
        const auto frame = scene.law == SolidLaw::kCorotationalPolar ? ElementFrame::kPolar : ElementFrame::kFirstEdge;
        TERES_TRY_ASSIGN(CorotationalTets tets, CorotationalTets::make(scene.mesh, scene.poissons_ratio, frame));
        body = std::make_unique<CorotationalTets>(std::move(tets));
    }
    TERES_TRY_ASSIGN(TetSystem system, TetSystem::make(std::move(body), scene.node_mass_kg, scene.held));
    system.gravity = run.gravity_m_s2;
    system.rayleigh_mass = run.rayleigh_mass_1_s;
    system.rayleigh_stiffness = run.rayleigh_stiffness_s;
    system.cg_iterations = run.cg_iterations;
    system.cg_tolerance = run.cg_tolerance;
    model.system_ = std::make_unique<TetSystem>(std::move(system));
    for (std::size_t a = 0; a < scene.held.size(); ++a)
        if (!scene.held[a]) model.free_nodes_.push_back(static_cast<NodeIndex>(a));
    return model;
}

PeerModel::Lane::Lane(const PeerModel& model) : stepper(model.system()), modulus(model.scene().mesh.tets.size(), 0.0) {}

MotionState PeerModel::rest() const {
    MotionState state;
    state.x.resize(system_->num_dofs());
    for (Index a = 0; a < system_->node_mass.size(); ++a) {
        const auto& p = scene_->mesh.nodes[static_cast<std::size_t>(a)];
        state.x.segment<3>(3 * a) << p[0], p[1], p[2];
    }
    state.v = VectorXd::Zero(state.x.size());
    return state;
}

int PeerModel::last_step() const {
    // A table may end one step early (the generator looks one row further than the filter); its last row then
    // holds.
    std::size_t last = static_cast<std::size_t>(std::numeric_limits<int>::max());
    if (scene_->tool)
        last = std::min(last, scene_->tool->rows.size() - static_cast<std::size_t>(run_->tool_row_offset));
    for (const Load& load : scene_->loads)
        if (!load.rows.empty()) last = std::min(last, load.rows.size() - static_cast<std::size_t>(load.row_offset));
    return static_cast<int>(last);
}

namespace {

bool attached(const std::vector<StepRange>& ranges, int k) {
    return ranges.empty() ||
           std::any_of(ranges.begin(), ranges.end(), [&](const StepRange& r) { return r.contains(k); });
}

template <class Rows>
const auto& row_at(const Rows& rows, int row) {
    return rows[static_cast<std::size_t>(std::clamp(row, 0, static_cast<int>(rows.size()) - 1))];
}

void add_load(const Load& load, int k, VectorXd& force) {
    if (!attached(load.steps, k)) return;
    // Steps 1..first carry the first group, then the groups take turns.
    const bool other = load.swap_every_steps > 0 && k > load.first_swap_after_steps &&
                       (k - load.first_swap_after_steps - 1) / load.swap_every_steps % 2 == 0;
    const auto& nodes = other ? load.other_nodes : load.nodes;
    Eigen::Vector3d f = other ? load.other_force_n : load.force_n;
    if (!load.rows.empty()) f = row_at(load.rows, k + load.row_offset);
    for (const auto node : nodes) force.segment<3>(3 * Index(node)) += f;
}

}  // namespace

bool PeerModel::advance(int k, const VectorXd& theta, Lane& lane, MotionState& state) const noexcept {
    const Scene& scene = *scene_;
    std::vector<double> modulus = scene.modulus_pa;
    lane.springs.clear();
    if (scene.springs) lane.springs = scene.springs->springs;
    if (theta.size() == 0) {
        for (const Event& event : scene.events)
            if (k >= event.from_step)
                for (const auto s : event.springs)
                    for (std::size_t i = 0; i < 3; ++i)
                        if (event.k[i]) lane.springs[s].k[i] = *event.k[i];
    }
    for (Index p = 0; p < theta.size(); ++p) {
        const ParameterTarget& target = scene.filter.targets[static_cast<std::size_t>(p)];
        for (const auto r : target.regions) modulus[r] = theta(p);
        for (const auto s : target.springs) lane.springs[s].k[target.coefficient] = theta(p);
    }
    for (std::size_t e = 0; e < lane.modulus.size(); ++e) lane.modulus[e] = modulus[scene.region[e]];
    if (scene.tool && attached(run_->tool_attached, k)) {
        const Eigen::Matrix3Xd& at = row_at(scene.tool->rows, k + run_->tool_row_offset);
        AnchorSpring spring;
        spring.k[0] = scene.tool->stiffness_n_per_m;
        for (std::size_t i = 0; i < scene.tool->nodes.size(); ++i) {
            spring.node = scene.tool->nodes[i];
            spring.anchor = at.col(at.cols() == 1 ? 0 : Index(i));
            lane.springs.push_back(spring);
        }
    }
    StepDrive drive{lane.modulus, lane.springs, nullptr};
    if (!scene.loads.empty()) {
        lane.outer_force.setZero(system_->num_dofs());
        for (const Load& load : scene.loads) add_load(load, k, lane.outer_force);
        drive.outer_force = &lane.outer_force;
    }
    switch (run_->integrator) {
        case Integrator::kImplicitEuler:
            return lane.stepper.implicit_euler(drive, run_->dt_s, run_->velocity_damping_1_s, state);
        case Integrator::kImplicitMidpoint:
            return lane.stepper.implicit_midpoint(drive, run_->dt_s, run_->velocity_damping_1_s, state);
        case Integrator::kStatic:
            return lane.stepper.static_equilibrium(drive, run_->equilibrium, state);
    }
    return false;
}

VectorXd observe(const std::vector<ObservedPoint>& points, const VectorXd& x) {
    VectorXd z = VectorXd::Zero(3 * static_cast<Index>(points.size()));
    for (std::size_t j = 0; j < points.size(); ++j)
        for (std::size_t i = 0; i < 4; ++i)
            z.segment<3>(3 * Index(j)) += points[j].weight[i] * x.segment<3>(3 * Index(points[j].node[i]));
    return z;
}

double rounded(double value, int digits) {
    if (digits <= 0) return value;
    char text[64];
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    return std::strtod(text, nullptr);
}

int observation_row(const Scene& scene, int k) {
    const Recording& recording = scene.recording;
    const double dt_file = recording.stored && recording.stored_dt_s > 0.0
                               ? recording.stored_dt_s
                               : scene.generator.dt_s * recording.record_every_steps;
    return static_cast<int>(std::lround(k * scene.filter_run.dt_s / dt_file)) + scene.observation_row_offset;
}

Result<std::vector<VectorXd>> observations(const Scene& scene, const PeerModel& generator, int last_row) {
    const Recording& recording = scene.recording;
    std::vector<VectorXd> rows;
    const auto record = [&](const VectorXd& x) {
        VectorXd values = recording.all_nodes ? x : observe(scene.points, x);
        for (double& value : values) value = rounded(value, recording.significant_digits);
        rows.push_back(recording.all_nodes ? observe(scene.points, values) : std::move(values));
    };
    if (recording.stored) {
        if (static_cast<std::size_t>(last_row) >= recording.rows.size())
            return invalid_input((scene.folder / "scene.json").string() + ": the filter needs row " +
                                 std::to_string(last_row) + " of the stored observations, which have " +
                                 std::to_string(recording.rows.size()) + " rows");
        for (int row = 0; row <= last_row; ++row) {
            const VectorXd& values = recording.rows[static_cast<std::size_t>(row)];
            rows.push_back(recording.all_nodes ? observe(scene.points, values) : values);
        }
        return rows;
    }
    const int last_step = recording.first_record_step + last_row * recording.record_every_steps;
    if (last_step > generator.last_step())
        return invalid_input((scene.folder / "scene.json").string() + ": the generator has to run to step " +
                             std::to_string(last_step) + ", but the tool or load table ends at step " +
                             std::to_string(generator.last_step()));
    PeerModel::Lane lane(generator);
    MotionState state = generator.rest();
    for (int step = 0; static_cast<int>(rows.size()) <= last_row; ++step) {
        if (step > 0 && !generator.advance(step, VectorXd(), lane, state))
            return not_usable(scene.folder.string() + ": the generator's step " + std::to_string(step) +
                              " has no solution");
        if (step >= recording.first_record_step &&
            (step - recording.first_record_step) % recording.record_every_steps == 0)
            record(state.x);
    }
    return rows;
}

}  // namespace teres::peer
