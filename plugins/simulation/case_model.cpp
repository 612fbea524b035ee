#include "plugins/simulation/case_model.h"

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <map>

#include "core/check.h"
#include "plugins/simulation/tissue_cut.h"

namespace teres {

using Eigen::Vector3d;

namespace {

Vector3d as_vector(const Point& p) {
    return {p[0], p[1], p[2]};
}

Result<BodyData> body_of(const Case& c, const std::string& law) {
    BodyData body = c.body;
    if (law == "case") return body;
    if (law == "ogden" && c.body.law != BodyLaw::kOgden)
        return invalid_input(
            "law = \"ogden\" needs a case whose body is ogden (shear_modulus_pa, alpha, bulk_modulus_pa)");
    body.law = law == "stvk"           ? BodyLaw::kStVK
               : law == "corotational" ? BodyLaw::kCorotational
               : law == "neo_hookean"  ? BodyLaw::kNeoHookean
                                       : BodyLaw::kOgden;
    return body;
}

Result<TimeScheme> scheme_of(const Case& c, const std::string& integrator) {
    if (integrator == "auto") return c.quasi_static ? TimeScheme::kQuasiStatic : TimeScheme::kGeneralisedAlpha;
    if (integrator == "quasi_static") return TimeScheme::kQuasiStatic;
    if (integrator == "implicit_euler") return TimeScheme::kImplicitEuler;
    if (integrator == "generalised_alpha") return TimeScheme::kGeneralisedAlpha;
    return invalid_input("integrator = \"" + integrator +
                         "\" is not one of auto, quasi_static, implicit_euler, generalised_alpha");
}

}  // namespace

Result<std::unique_ptr<CaseModel>> CaseModel::make(const Case& c, const CaseModelSettings& settings) {
    std::unique_ptr<CaseModel> m(new CaseModel());
    TERES_TRY_ASSIGN(m->mesh_, TetMesh::make(c.mesh));
    TERES_TRY_ASSIGN(const BodyData body, body_of(c, settings.law));
    TERES_TRY_ASSIGN(const Material material, Material::make(body));
    TERES_TRY_ASSIGN(m->scheme_, scheme_of(c, settings.integrator));
    const bool dynamic = m->scheme_ != TimeScheme::kQuasiStatic;
    const bool gravity = as_vector(c.gravity_m_s2).norm() > 0.0;
    if ((dynamic || gravity) && !(body.density_kg_m3 > 0.0))
        return invalid_input(c.folder.string() + "/case.json: body.density_kg_m3 = " +
                             std::to_string(body.density_kg_m3) + " must be above 0 for a dynamic case or gravity");

    std::vector<StrainPoints> points = make_strain_points(m->mesh_, settings.element, settings.shear_blend);
    if (settings.separate_parts) points = separate_parts(std::move(points));
    MechanicalSystem::Parts parts{m->mesh_.X, Body(std::move(points), material), {}, {}, {}, {},
                                  {},         as_vector(c.gravity_m_s2),         0};
    QuadraticMesh quadratic;
    if (settings.element == ElementType::kQuadratic) {
        quadratic = make_quadratic(m->mesh_);
        parts.X = quadratic.X;
    }
    const auto nodes = static_cast<std::size_t>(parts.X.cols());
    parts.held.assign(nodes, 0);
    for (const auto node : c.clamped) parts.held[static_cast<std::size_t>(node)] = 1;

    // Lumped mass: a quarter of each tetrahedron per corner; 10-node: rows of the consistent mass scaled
    // (HRZ), 1/36 and 4/27.
    parts.node_mass_kg.setZero(static_cast<Eigen::Index>(nodes));
    for (std::size_t e = 0; e < m->mesh_.tets.size(); ++e) {
        const double mass = body.density_kg_m3 * m->mesh_.volume[e];
        if (settings.element == ElementType::kQuadratic)
            for (std::size_t i = 0; i < 10; ++i)
                parts.node_mass_kg(quadratic.tets[e][i]) += mass * (i < 4 ? 1.0 / 36.0 : 4.0 / 27.0);
        else
            for (const auto node : m->mesh_.tets[e]) parts.node_mass_kg(node) += 0.25 * mass;
    }

    // Ligament: groups of unknown stiffness, or the atlas region held fixed.
    if (settings.boundary == "atlas_fixed") {
        for (const auto& entry : c.ligament_prior)
            if (entry.probability >= settings.fixed_probability)
                parts.held[static_cast<std::size_t>(entry.node_id)] = 1;
    } else if (!c.ligament_prior.empty() && c.ligament) {
        TERES_TRY(check_spring_law(settings.ligament.spring_law));
        m->ligament_ = make_ligament(m->mesh_, c.ligament_prior, *c.ligament, settings.ligament);
        parts.tethers = m->ligament_.tethers;
        for (std::size_t g = 0; g < m->ligament_.groups.size(); ++g) {
            const auto& group = m->ligament_.groups[g];
            m->parameters_.push_back({"ligament.r" + std::to_string(g) + ".stiffness", "N/m",
                                      group.prior_median_n_per_m, settings.ligament.log_stdev,
                                      1e-4 * group.full_stiffness_n_per_m, 1e2 * group.full_stiffness_n_per_m,
                                      group.threshold_n_per_m});
        }
        for (std::size_t i = 0; i < m->ligament_.node.size(); ++i)
            m->attachment_.push_back({m->ligament_.node[i], m->ligament_.group[i], m->ligament_.probability[i]});
    }
    m->add_springs(c, parts);
    if (settings.element == ElementType::kQuadratic)  // a mid-edge node between two held corners is held
        for (std::size_t i = 0; i < quadratic.edge.size(); ++i)
            if (parts.held[static_cast<std::size_t>(quadratic.edge[i][0])] &&
                parts.held[static_cast<std::size_t>(quadratic.edge[i][1])])
                parts.held[m->mesh_.num_nodes() + i] = 1;

    for (const auto& region : c.load_regions) {
        parts.loads.push_back({region.node_ids, region.weights});
        m->region_names_.push_back(region.name);
    }
    for (const auto& tool : c.tools) {
        parts.tools.push_back({tool.node_id, tool.stiffness_n_per_m});
        m->tool_names_.push_back(tool.name);
    }
    bool anything_holds = !parts.tethers.empty() || !parts.tools.empty();
    for (const char held : parts.held) anything_holds = anything_holds || held != 0;
    if (!anything_holds && !dynamic)
        return invalid_input(c.folder.string() +
                             ": nothing holds the body (no clamped.csv, ligament_prior.csv with case.json "
                             "ligament, springs.csv or tool_nodes.csv): its rigid motion is undetermined");

    for (const auto& marker : c.markers) {
        m->markers_.push_back(ride(m->mesh_, as_vector(marker.position_m)));
        m->marker_ids_.push_back(marker.id);
    }
    for (const auto& point : c.validation_rest) {
        m->points_.push_back(embed(m->mesh_, as_vector(point.position_m)));
        m->point_ids_.push_back(point.id);
    }

    m->marker_lost_.assign(m->markers_.size(), 0);
    m->can_be_cut_ = settings.element != ElementType::kQuadratic;

    parts.num_parameters = m->parameters_.size();
    parts.threads = settings.threads;
    m->max_lanes_ = static_cast<std::size_t>(settings.max_lanes);
    m->system_ = std::make_unique<MechanicalSystem>(std::move(parts));
    m->solver_ = std::make_unique<EquilibriumSolver>(*m->system_, settings.equilibrium, m->max_lanes_);
    m->stepper_ =
        std::make_unique<TimeStepper>(*m->system_, *m->solver_,
                                      TimeStepSettings{m->scheme_, settings.spectral_radius, body.rayleigh_mass_1_s,
                                                       body.rayleigh_stiffness_s, settings.max_step_s},
                                      m->max_lanes_);
    const std::size_t stride = padded_lanes(m->max_lanes_);
    m->motion_.assign(3 * m->num_nodes(), 0.0);
    m->motion_before_ = m->motion_;
    m->x_.assign(m->num_state() * stride, 0.0);
    m->theta_.assign(std::max<std::size_t>(1, m->parameters_.size()) * stride, 0.0);
    return m;
}

// springs.csv: springs without a group are known, those of a group share one unknown factor (prior 1, a
// factor e^1 wide).
void CaseModel::add_springs(const Case& c, MechanicalSystem::Parts& parts) {
    std::map<std::string, std::int32_t> group;
    for (const auto& data : c.springs) {
        Tether t;
        t.node = data.node_id;
        t.kind = data.law == SpringLaw::kLinear ? Tether::Kind::kBar : Tether::Kind::kSpring;
        t.spring.law = data.law == SpringLaw::kCubic        ? AnchorLaw::kCubicTension
                       : data.law == SpringLaw::kPolynomial ? AnchorLaw::kPolynomialTension
                                                            : AnchorLaw::kRestShape;
        t.spring.anchor = as_vector(data.anchor_m);
        t.spring.k = data.k;
        t.spring.rest_length = data.rest_length_m;
        if (!data.group.empty()) {
            const auto [entry, added] = group.try_emplace(data.group, static_cast<std::int32_t>(parameters_.size()));
            if (added) parameters_.push_back({"spring." + data.group + ".factor", "1", 1.0, 1.0, 1e-4, 1e4, 0.1});
            t.parameter = entry->second;
        }
        parts.tethers.push_back(t);
    }
}

std::size_t CaseModel::num_state() const {
    return state_blocks(scheme_) * 3 * num_nodes();
}

ForwardParameter CaseModel::parameter(std::size_t index) const {
    const auto& p = parameters_[index];
    return {p.name.c_str(), p.unit.c_str(), p.prior_median, p.prior_log_stdev, 0.0, p.lower, p.upper, p.threshold};
}

void CaseModel::rest_state(std::span<double> x) const {
    TERES_CHECK(x.size() == num_state());
    std::fill(x.begin(), x.end(), 0.0);
    std::copy_n(system_->parts().X.data(), 3 * num_nodes(), x.begin());
    if (scheme_ == TimeScheme::kGeneralisedAlpha)  // released from rest, unstrained: a = g
        for (std::size_t i = 0; i < num_nodes(); ++i)
            if (!system_->parts().held[i])
                for (std::size_t a = 0; a < 3; ++a)
                    x[6 * num_nodes() + 3 * i + a] = system_->parts().gravity_m_s2(static_cast<Eigen::Index>(a));
}

// Start values of a quasi-static step: bodies go on moving and accelerating as they did, by the mean motions of the
// last two steps' lanes.
void CaseModel::predict(double time_s, std::size_t lanes, std::size_t stride) noexcept {
    const double dt = time_s - motion_time_s_;
    if (scheme_ != TimeScheme::kQuasiStatic || lanes != motion_lanes_ || !(motion_dt_s_ > 0.0) || !(dt > 0.0) ||
        dt > 2.0 * motion_dt_s_)
        return;
    // x + dt v + dt^2 (v - v') / dt'
    const double share = dt / motion_dt_s_;
    const double change = motion_before_dt_s_ > 0.0 ? share * share : 0.0;
    const double before = change > 0.0 ? change * motion_dt_s_ / motion_before_dt_s_ : 0.0;
    for (std::size_t d = 0; d < motion_.size(); ++d) {
        const double step = (share + change) * motion_[d] - before * motion_before_[d];
        for (std::size_t l = 0; l < stride; ++l) x_[d * stride + l] += step;
    }
}

void CaseModel::remember(double time_s, std::span<const double> start, std::size_t lanes, std::size_t stride) noexcept {
    if (scheme_ != TimeScheme::kQuasiStatic) return;
    const std::size_t rows = motion_.size();
    motion_before_.swap(motion_);
    motion_before_dt_s_ = lanes == motion_lanes_ ? motion_dt_s_ : 0.0;
    std::fill(motion_.begin(), motion_.end(), 0.0);
    for (std::size_t l = 0; l < lanes; ++l)
        for (std::size_t d = 0; d < rows; ++d)
            motion_[d] += (x_[d * stride + l] - start[l * rows + d]) / static_cast<double>(lanes);
    motion_dt_s_ = lanes == motion_lanes_ ? time_s - motion_time_s_ : 0.0;
    motion_time_s_ = time_s;
    motion_lanes_ = lanes;
}

// Nodes that a cut has left without tissue.
void CaseModel::rest_bare_nodes(std::size_t stride) noexcept {
    const std::size_t block = 3 * num_nodes();
    for (std::size_t a = 0; a < mesh_.num_nodes(); ++a)
        for (std::size_t d = 3 * a; d < 3 * a + 3 && mesh_.node_volume[a] == 0.0; ++d)
            for (std::size_t row = d; row < num_state(); row += block)
                std::fill_n(&x_[row * stride], stride, row < block ? mesh_.X.data()[d] : 0.0);
}

ForwardReport CaseModel::advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                                 std::size_t lanes) noexcept {
    const std::size_t rows = num_state(), stride = padded_lanes(lanes), parameters = parameters_.size();
    TERES_CHECK(lanes > 0 && lanes <= max_lanes_ && X.size() == rows * lanes && theta.size() == parameters * lanes);
    system_->resolve(inputs.region_force_n, inputs.tool_position_m, actions_);
    for (std::size_t l = 0; l < stride; ++l) {  // padding lanes repeat lane 0
        const std::size_t from = l < lanes ? l : 0;
        for (std::size_t d = 0; d < rows; ++d) x_[d * stride + l] = X[from * rows + d];
        for (std::size_t p = 0; p < parameters; ++p) theta_[p * stride + l] = theta[from * parameters + p];
    }
    predict(inputs.time_s, lanes, stride);
    rest_bare_nodes(stride);
    const EquilibriumReport r = stepper_->step(actions_, inputs.dt_s, theta_.data(), x_.data(), lanes);
    remember(inputs.time_s, X, lanes, stride);
    for (std::size_t l = 0; l < lanes; ++l)
        for (std::size_t d = 0; d < rows; ++d) X[l * rows + d] = x_[d * stride + l];
    return {static_cast<std::int32_t>(lanes), r.lanes_converged, r.iterations, r.factorisations, r.relative_residual};
}

CutReport CaseModel::cut(std::span<const std::int32_t> tets, std::span<const std::int32_t> parameters) noexcept {
    const auto within = [](std::span<const std::int32_t> indices, std::size_t size) {
        return std::ranges::all_of(indices, [&](auto i) { return i >= 0 && static_cast<std::size_t>(i) < size; });
    };
    if (!within(tets, mesh_.tets.size()) || !within(parameters, parameters_.size()))
        return {CutOutcome::kUnknownIndex, 0};
    if (!can_be_cut_) return {CutOutcome::kNotSupported, 0};
    auto& parts = system_->parts();
    std::vector<char> holds;  // a piece that nothing holds has no equilibrium; it may fly if the case is dynamic
    if (scheme_ == TimeScheme::kQuasiStatic) {
        holds = parts.held;
        for (const auto& tool : parts.tools) holds[static_cast<std::size_t>(tool.node)] = 1;
        for (const auto& t : parts.tethers)
            if (t.share > 0.0 && std::ranges::find(parameters, t.parameter) == parameters.end())
                for (std::size_t i = 0; i < t.num_nodes(); ++i) holds[static_cast<std::size_t>(t.node_at(i))] = 1;
    }
    const std::vector<char> left = tissue_left(mesh_, tets, holds);
    if (std::ranges::find(left, 1) == left.end()) return {CutOutcome::kNothingHolds, 0};

    solver_->release_system();
    for (const auto parameter : parameters) release(parameter, parts.tethers);
    const std::int32_t removed = keep_tissue(left, mesh_, parts);
    solver_->follow_system();
    motion_dt_s_ = 0.0;
    for (std::size_t k = 0; k < markers_.size(); ++k) {  // its triangle belonged to one tetrahedron
        const auto& corners = markers_[k].node;
        marker_lost_[k] = 1;
        for (std::size_t e = 0; e < left.size() && marker_lost_[k]; ++e)
            marker_lost_[k] = !left[e] || !std::ranges::all_of(corners, [&](NodeIndex node) {
                return std::ranges::find(mesh_.tets[e], node) != mesh_.tets[e].end();
            });
    }
    return {CutOutcome::kDone, removed};
}

void CaseModel::observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept {
    const std::size_t rows = num_state(), outputs = 3 * markers_.size();
    TERES_CHECK(X.size() == rows * lanes && Z.size() == outputs * lanes);
    for (std::size_t l = 0; l < lanes; ++l)
        for (std::size_t k = 0; k < markers_.size(); ++k) {
            const auto& rider = markers_[k];
            Vector3d corner[3], z = Vector3d::Zero();
            for (std::size_t i = 0; i < 3; ++i) {
                corner[i] = Eigen::Map<const Vector3d>(&X[l * rows + 3 * static_cast<std::size_t>(rider.node[i])]);
                z += rider.weight[i] * corner[i];
            }
            z += rider.offset_m * (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
            for (std::size_t a = 0; a < 3; ++a) Z[l * outputs + 3 * k + a] = z(static_cast<Eigen::Index>(a));
        }
}

void CaseModel::predict_points(std::span<const double> x, std::span<double> out) const noexcept {
    TERES_CHECK(x.size() == num_state() && out.size() == 3 * points_.size());
    for (std::size_t k = 0; k < points_.size(); ++k) {
        Vector3d p = Vector3d::Zero();
        for (std::size_t i = 0; i < 4; ++i)
            p +=
                points_[k].weight[i] * Eigen::Map<const Vector3d>(&x[3 * static_cast<std::size_t>(points_[k].node[i])]);
        for (std::size_t a = 0; a < 3; ++a) out[3 * k + a] = p(static_cast<Eigen::Index>(a));
    }
}

}  // namespace teres
