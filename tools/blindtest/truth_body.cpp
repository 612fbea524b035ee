#include "tools/blindtest/truth_body.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/case/geometry.h"
#include "tools/blindtest/lattice_mesher.h"
#include "tools/blindtest/liver_shape.h"

namespace teres::blindtest {
namespace {

using calculix::CalculixMaterial;
using calculix::CalculixRecording;
using calculix::Curve;

constexpr double kPi = std::numbers::pi;
constexpr Point kCamera{0.0, 0.0, 0.35};
constexpr double kClampRadius = 0.026, kPatchRadius = 0.026;  // [m]
constexpr double kLead = 1.0;           // [s] in which a state that does not start at rest is reached
constexpr double kSolverLimit = 420.0;  // [s]
constexpr std::size_t kBandLayers = 1;

TetMeshData mesh_shape(const BodyShape& shape, double tets, Random& random) {
    const auto [low, high] = shape.box();
    LatticeOptions options{low, high, 0.03, random.direction(), random.uniform(0.0, 1.0)};
    const auto level = [&](const Point& p) { return shape.level(p); };
    const TetMeshData coarse = mesh_level_set(level, options);
    // Tetrahedra number about as 1 / cell^3.
    options.cell_m *= std::cbrt(static_cast<double>(coarse.tets.size()) / tets);
    return mesh_level_set(level, options);
}

// Curve over these frames, one step after the other, reached from zero in the lead-in.
Curve frame_curve(double lead_s, double dt_s, std::span<const std::size_t> frames, const auto& value) {
    Curve curve;
    if (lead_s > 0.0) {
        curve.t_s.push_back(0.0);
        curve.value.push_back(0.0);
    }
    for (std::size_t k = 0; k < frames.size(); ++k) {
        curve.t_s.push_back(lead_s + static_cast<double>(k) * dt_s);
        curve.value.push_back(value(frames[k]));
    }
    return curve;
}

void add_support(CalculixRecording& r, const std::vector<std::int32_t>& nodes) {
    for (int axis = 0; axis < 3; ++axis) r.supports.push_back({nodes, axis, {}});
}

std::vector<std::int32_t> nodes_of(const TruthMesh& mesh, const Facets& facets) {
    std::vector<std::int32_t> ids;
    for (const std::int32_t t : mesh.find(facets))
        for (const std::int32_t node : mesh.face_nodes(static_cast<std::size_t>(t))) ids.push_back(node);
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    return ids;
}

// Nodes of another mesh of the body in place of a held patch of the truth. Where little else holds, the extent of a
// clamp decides how far the body swings, and as much of the surface as the patch has would hold less, for only
// triangles whose nodes are all held are: the nearest are taken until theirs (a third of each triangle about a node)
// is 1.5 times the patch. On such a clamp alone two bodies move 1.20 and 1.07 times as far as the truth.
std::vector<std::int32_t> nodes_covering(const TruthMesh& truth, const Facets& patch, const TetMeshData& mesh,
                                         const Surface& surface) {
    constexpr double kOwnArea = 1.5;
    const std::vector<std::int32_t> triangles = truth.find(patch);
    if (triangles.empty()) return {};
    const auto position = [&](std::int32_t node) -> const Point& { return mesh.nodes[static_cast<std::size_t>(node)]; };
    const auto of_truth = [&](std::int32_t node) -> const Point& {
        return truth.nodes()[static_cast<std::size_t>(node)];
    };
    const auto away = [&](const Point& p) {
        double least = std::numeric_limits<double>::infinity();
        for (const std::int32_t t : triangles) {
            const auto& [a, b, c] = truth.surface().triangles()[static_cast<std::size_t>(t)];
            const auto w = closest_barycentric(p, of_truth(a), of_truth(b), of_truth(c));
            const Point on = plus(plus(times(w[0], of_truth(a)), times(w[1], of_truth(b))), times(w[2], of_truth(c)));
            least = std::min(least, distance(p, on));
        }
        return least;
    };
    double wanted_m2 = 0.0;
    for (const std::int32_t t : triangles) wanted_m2 += kOwnArea * truth.area(static_cast<std::size_t>(t));
    std::map<std::int32_t, double> own_m2;
    for (const auto& triangle : surface.triangles()) {
        const auto& [a, b, c] = triangle;
        const double area_m2 = 0.5 * norm(cross(minus(position(b), position(a)), minus(position(c), position(a))));
        for (const std::int32_t node : triangle) own_m2[node] += area_m2 / 3.0;
    }
    std::vector<std::pair<double, std::int32_t>> nearest;
    for (const std::int32_t node : surface.nodes()) nearest.emplace_back(away(position(node)), node);
    std::sort(nearest.begin(), nearest.end());
    std::vector<std::int32_t> nodes;
    double sum_m2 = 0.0;
    for (const auto& [apart, node] : nearest) {
        if (nodes.size() >= 3 && sum_m2 + 0.5 * own_m2[node] >= wanted_m2) break;
        nodes.push_back(node);
        sum_m2 += own_m2[node];
    }
    std::sort(nodes.begin(), nodes.end());
    return nodes;
}

// The load of a quadratic face falls on its mid-edge nodes, a third of the area each.
std::map<std::int32_t, double> node_areas(const TruthMesh& mesh, const Facets& facets) {
    std::map<std::int32_t, double> areas;
    for (const std::int32_t t : mesh.find(facets)) {
        const auto nodes = mesh.face_nodes(static_cast<std::size_t>(t));
        for (std::size_t i = 3; i < 6; ++i) areas[nodes[i]] += mesh.area(static_cast<std::size_t>(t)) / 3.0;
    }
    return areas;
}

Point moved(const QuadraticPoint& sample, const Point& rest, const std::map<std::int32_t, Point>& u) {
    Point p = rest;
    for (const auto& [node, weight] : sample.weights) p = plus(p, times(weight, u.at(node)));
    return p;
}

// Which face 1..4 of C3D10 (1-2-3, 1-4-2, 2-4-3, 3-4-1) a surface triangle is.
std::array<std::int32_t, 3> element_face(const TruthMesh& mesh, std::size_t triangle) {
    const auto& corners = mesh.surface().triangles()[triangle];
    constexpr std::array<std::array<std::size_t, 3>, 4> kFaces{{{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}}};
    for (std::size_t e = 0; e < mesh.corners().tets.size(); ++e)
        for (std::size_t f = 0; f < 4; ++f) {
            std::array<std::int32_t, 3> face{};
            for (std::size_t i = 0; i < 3; ++i) face[i] = mesh.corners().tets[e][kFaces[f][i]];
            if (std::is_permutation(face.begin(), face.end(), corners.begin()))
                return {0, static_cast<std::int32_t>(e), static_cast<std::int32_t>(f + 1)};
        }
    return {-1, -1, -1};
}

}  // namespace

// Hyperelastic laws of the same small-strain behaviour; none is the modeller's own form.
calculix::CalculixMaterial draw_law(double youngs_modulus_pa, double poissons_ratio, Random& random) {
    CalculixMaterial material;
    material.youngs_modulus_pa = youngs_modulus_pa;
    material.poissons_ratio = poissons_ratio;
    material.density_kg_m3 = 1060.0;
    using Law = CalculixMaterial::Law;
    material.law = std::array{Law::kNeoHookean, Law::kYeoh, Law::kOgden}[random.index(3)];
    material.alpha = random.uniform(0.8, 3.0);
    material.yeoh_c20_pa = random.uniform(0.02, 0.12) * material.shear_modulus_pa();
    return material;
}

Result<TruthBody> TruthBody::make(const BodyOptions& options, const std::filesystem::path& scratch) {
    Random random(options.seed, {options.draw, options.clamped ? 1U : 0U, options.dynamic ? 1U : 0U});
    if (options.given) {
        TERES_TRY(check_given(*options.given));
        const auto shape = std::make_shared<const MeshShape>(options.given->mesh);
        TruthBody body(options, shape, random);
        TERES_TRY(body.take(*options.given, *shape, random));
        return body;
    }
    TruthBody body(options, std::make_shared<const LiverShape>(random), random);
    body.draw(random);
    TERES_TRY(body.scale_loads(scratch));
    return body;
}

TruthBody::TruthBody(const BodyOptions& options, std::shared_ptr<const BodyShape> shape, Random& random)
    : options_(options), shape_(std::move(shape)), mesh_(mesh_shape(*shape_, options.truth_tets, random)) {}

void TruthBody::draw(Random& random) {
    believe(random);
    const double s = shape_->scale();
    if (options_.clamped) {
        clamp_centre_m_ = shape_->exit(shape_->centre(), {-0.1, 0.1, -0.99});
        clamp_ = facets([&](const Point& c, const Point&) { return distance(c, clamp_centre_m_) < kClampRadius * s; });
    }
    control_.band = facets_of(true_band_);
    place_loads(random);
    place_samples(random);
}

Facets TruthBody::facets_of(const Band& band) const {
    Facets chosen = facets([&](const Point& c, const Point&) { return band.contains(c); });
    const auto angle = [&](const Point& p) { return std::atan2(p[1] - band.axis_m[1], p[2] - band.axis_m[2]); };
    std::sort(chosen.begin(), chosen.end(), [&](const Point& a, const Point& b) { return angle(a) < angle(b); });
    return chosen;
}

// What the modeller believes: mesh, law, ligament prior, sensor; and the true counterparts.
void TruthBody::believe(Random& random) {
    Case& c = nominal_;
    c.frame = "x to the patient's left, y up (cranial), z to the front";
    c.num_frames = options_.frames;
    c.quasi_static = !options_.dynamic;
    c.dt_s = options_.dynamic ? 0.04 : 0.25;
    c.mesh = mesh_shape(*shape_, options_.case_tets, random);

    BodyData& body = c.body;
    body.poissons_ratio = random.uniform(0.45, 0.485);
    body.youngs_modulus_pa = random.log_uniform(6e3, 20e3);
    body.density_kg_m3 = 1060.0;
    const double law = random.uniform();
    body.law = law < 0.5 ? BodyLaw::kOgden : law < 0.75 ? BodyLaw::kNeoHookean : BodyLaw::kStVK;
    if (body.law == BodyLaw::kOgden) {
        body.alpha = 0.88;
        body.shear_modulus_pa = body.youngs_modulus_pa / (2.0 * (1.0 + body.poissons_ratio));
        body.bulk_modulus_pa = body.youngs_modulus_pa / (3.0 * (1.0 - 2.0 * body.poissons_ratio));
    }
    control_.body = draw_law(body.youngs_modulus_pa, body.poissons_ratio, random);

    const double s = shape_->scale();
    prior_band_ = {.axis_m = {0.0, 0.030 * s, 0.0},
                   .x0_m = random.uniform(0.004, 0.020) * s,
                   .tilt_m = 0.0,
                   .width_m = 0.024,
                   .theta0_deg = -35.0,
                   .theta1_deg = 100.0,
                   .height_m = random.uniform(0.018, 0.026),
                   .youngs_modulus_pa = random.log_uniform(40e3, 100e3),
                   .poissons_ratio = 0.45};
    true_band_ = prior_band_;
    true_band_.x0_m += random.uniform(-0.008, 0.008);
    true_band_.tilt_m = random.uniform(-0.008, 0.008);
    true_band_.width_m *= random.uniform(1.0, 1.35);
    true_band_.theta0_deg += random.uniform(0.0, 30.0);
    true_band_.theta1_deg -= random.uniform(0.0, 25.0);
    true_band_.youngs_modulus_pa *= random.log_uniform(0.6, 1.6);
    control_.ligament = {.law = CalculixMaterial::Law::kNeoHookean,
                         .youngs_modulus_pa = true_band_.youngs_modulus_pa,
                         .poissons_ratio = true_band_.poissons_ratio};
    if (options_.dynamic) control_.ligament.density_kg_m3 = 1060.0;
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, prior_band_.youngs_modulus_pa, prior_band_.poissons_ratio,
                              prior_band_.height_m,     prior_band_.width_m,           0.0};
    const Surface surface(c.mesh);
    for (const std::int32_t node : surface.nodes()) {
        const double p = prior_band_.prior_probability(c.mesh.nodes[static_cast<std::size_t>(node)]);
        if (p >= 0.005) c.ligament_prior.push_back({node, std::round(1e4 * p) / 1e4});
    }
    c.sensor.noise_sigma_m = random.uniform(0.0003, 0.0005);
    c.sensor.camera_position_m = kCamera;
    c.sensor.view_direction = Point{0.0, 0.0, -1.0};
    c.sensor.up = Point{0.0, 1.0, 0.0};
}

// Three patches; two incommensurate periods each, stronger in the second half.
void TruthBody::place_loads(Random& random) {
    const std::array<std::pair<const char*, Point>, 3> places{
        {{"F1", {-0.55, -0.75, 0.35}}, {"F2", {0.90, 0.10, 0.40}}, {"F3", {-0.80, 0.10, 0.55}}}};
    Case& c = nominal_;
    const Surface surface(c.mesh);
    const double fast = options_.dynamic ? 0.12 : 1.0;
    control_.forces_n.assign(num_frames(), std::vector<Point>(places.size()));
    for (std::size_t r = 0; r < places.size(); ++r) {
        const Point towards = plus(places[r].second, times(0.2, random.direction()));
        const Point centre =
            mesh_.surface().closest(shape_->exit(shape_->centre(), times(1.0 / norm(towards), towards))).position_m;
        regions_.push_back({centre, kPatchRadius, {}});
        LoadRegion region{places[r].first, {}, {}};
        for (const auto& [node, share] : patch_weights(c.mesh, surface, nullptr, centre, kPatchRadius)) {
            region.node_ids.push_back(node);
            region.weights.push_back(share);
        }
        c.load_regions.push_back(std::move(region));

        const Point normal = shape_->normal(centre), side = random.direction();
        const Point a = plus(normal, times(0.8, side)), b = plus(times(-0.6, normal), random.direction());
        const double period_a = fast * random.uniform(2.6, 4.0), period_b = fast * random.uniform(4.2, 6.5);
        const double share_b = random.uniform(0.4, 0.8);
        for (std::size_t k = 0; k < num_frames(); ++k) {
            const double t = time_s(k), half = 0.5 * time_s(num_frames() - 1);
            const double strength = 0.65 + 0.35 / (1.0 + std::exp(-(t - half) / (0.1 * half)));
            const double swing = strength * std::sin(2.0 * kPi * t / period_a);
            const double pull = 0.5 * strength * share_b * (1.0 - std::cos(2.0 * kPi * t / period_b));
            control_.forces_n[k][r] = plus(times(swing / norm(a), a), times(pull / norm(b), b));
        }
    }
    if (!options_.clamped) return;
    c.clamped = nodes_covering(mesh_, clamp_, c.mesh, surface);  // anatomy that the modeller sees
}

// Markers: facets that the camera sees, clear of the ligament and the clamp, spread out. Points: inside, below the
// surface.
void TruthBody::place_samples(Random& random) {
    const auto spread = [&](std::vector<Point> candidates, int count, std::vector<MarkerRest>& out) {
        std::vector<double> gap(candidates.size(), 1e9);
        std::size_t next = random.index(candidates.size());
        for (std::int32_t id = 0; id < count; ++id) {
            out.push_back({id, candidates[next]});
            for (std::size_t i = 0; i < candidates.size(); ++i)
                gap[i] = std::min(gap[i], distance(candidates[i], candidates[next]));
            next = static_cast<std::size_t>(std::max_element(gap.begin(), gap.end()) - gap.begin());
        }
    };
    std::vector<Point> seen;
    for (std::size_t t = 0; t < mesh_.surface().triangles().size(); ++t) {
        const Point c = mesh_.centroid(t), to_camera = minus(*nominal_.sensor.camera_position_m, c);
        const bool covered = options_.given ? std::count(control_.band.begin(), control_.band.end(), c) != 0
                                            : true_band_.contains(c) || prior_band_.prior_probability(c) > 0.3;
        if (covered || dot(shape_->normal(c), to_camera) < 0.35 * norm(to_camera)) continue;
        const auto& [a, b, d] = mesh_.surface().triangles()[t];
        const double u = random.uniform(0.2, 0.4), v = random.uniform(0.2, 0.4);
        const auto node = [&](std::int32_t id) { return mesh_.corners().nodes[static_cast<std::size_t>(id)]; };
        seen.push_back(plus(times(1.0 - u - v, node(a)), plus(times(u, node(b)), times(v, node(d)))));
    }
    if (nominal_.markers.empty()) spread(seen, options_.markers, nominal_.markers);
    if (!nominal_.validation_rest.empty()) return;
    std::vector<Point> inner;
    while (inner.size() < 400) {
        // the drawn body's: narrower than its box
        const auto [low, high] = shape_->box();
        const Point p = options_.given ? Point{random.uniform(low[0], high[0]), random.uniform(low[1], high[1]),
                                               random.uniform(low[2], high[2])}
                                       : Point{random.uniform(-0.13, 0.13), random.uniform(-0.11, 0.11),
                                               random.uniform(-0.09, 0.09)};
        if (shape_->level(p) < -0.010 && !in_body(mesh_, p).weights.empty()) inner.push_back(p);
    }
    spread(inner, options_.points, nominal_.validation_rest);
}

// Each region alone moves the markers by 4 to 7 mm (rms) at its peak, by the linear response.
Status TruthBody::scale_loads(const std::filesystem::path& scratch) {
    Random random(options_.seed, {options_.draw, 77});
    for (std::size_t r = 0; r < regions_.size(); ++r) {
        std::size_t peak = 0;
        for (std::size_t k = 0; k < num_frames(); ++k)
            if (norm(control_.forces_n[k][r]) > norm(control_.forces_n[peak][r])) peak = k;
        Scenario only = control_;
        only.patch_loads = {{regions_[r].centre_m, regions_[r].radius_m, {}}};
        for (std::size_t k = 0; k < num_frames(); ++k) only.patch_loads[0].force_n.push_back(control_.forces_n[k][r]);
        TERES_TRY_ASSIGN(const double rms, linear_rms(only, peak, scratch));
        // a dynamic body swings further than its static response
        if (!(rms > 0.0)) return not_usable("load patch " + std::to_string(r) + " misses the surface");
        const double scale = random.uniform(0.004, 0.007) * (options_.dynamic ? 0.35 : 1.0) / rms;
        for (std::size_t k = 0; k < num_frames(); ++k)
            for (double& f : control_.forces_n[k][r]) f = std::round(1e6 * scale * f) / 1e6;
    }
    for (std::size_t k = 0; k < num_frames(); ++k)
        for (std::size_t r = 0; r < regions_.size(); ++r)
            nominal_.loads.push_back({time_s(k), static_cast<std::int32_t>(r), control_.forces_n[k][r]});
    return {};
}

Result<Motion> TruthBody::simulate(const Scenario& scenario, const std::filesystem::path& scratch,
                                   const Motion* control) const {
    std::vector<std::size_t> all(num_frames());
    std::iota(all.begin(), all.end(), std::size_t{0});
    return simulate_at(scenario, all, scratch, control);
}

Result<Motion> TruthBody::simulate_at(const Scenario& scenario, std::span<const std::size_t> frames,
                                      const std::filesystem::path& scratch, const Motion* control) const {
    if (scenario.event_frame < 0) return solve(scenario, frames, false, false, scratch);
    const auto event = std::lower_bound(frames.begin(), frames.end(), static_cast<std::size_t>(scenario.event_frame));
    const std::span<const std::size_t> earlier(frames.begin(), event), later(event, frames.end());
    Motion motion;
    if (control != nullptr) {
        for (const std::size_t k : earlier) {
            motion.markers.push_back(control->markers[k]);
            motion.points.push_back(control->points[k]);
        }
    } else if (!earlier.empty()) {
        TERES_TRY_ASSIGN(motion, solve(scenario, earlier, false, false, scratch));
    }
    if (later.empty()) return motion;
    TERES_TRY_ASSIGN(const Motion after, solve(scenario, later, true, false, scratch));
    motion.markers.insert(motion.markers.end(), after.markers.begin(), after.markers.end());
    motion.points.insert(motion.points.end(), after.points.begin(), after.points.end());
    motion.solver_s += after.solver_s;
    return motion;
}

Result<double> TruthBody::linear_rms(Scenario scenario, std::size_t frame, const std::filesystem::path& scratch) const {
    for (auto& forces : scenario.forces_n) forces.assign(forces.size(), Point{});
    scenario.body.law = scenario.ligament.law = CalculixMaterial::Law::kLinear;
    TERES_TRY_ASSIGN(const Motion motion, solve(scenario, {&frame, 1}, true, true, scratch));
    double sum = 0.0;
    for (std::size_t m = 0; m < nominal_.markers.size(); ++m)
        sum += std::pow(distance(motion.markers[0][m], nominal_.markers[m].position_m), 2);
    return std::sqrt(sum / static_cast<double>(nominal_.markers.size()));
}

Result<Motion> TruthBody::solve(const Scenario& s, std::span<const std::size_t> frames, bool after_event, bool linear,
                                const std::filesystem::path& scratch) const {
    TruthMesh mesh = mesh_;
    if (after_event && s.cut_radius_m > 0.0) mesh.cut(s.cut_centre_m, s.cut_normal, s.cut_bend_1_m, s.cut_radius_m);
    const WedgeLayer band =
        mesh.extrude(mesh.find(after_event && s.event_frame >= 0 && !s.band_after.empty() ? s.band_after : s.band),
                     true_band_.height_m, kBandLayers);
    const WedgeLayer extra = mesh.extrude(mesh.find(s.extra_band), true_band_.height_m, kBandLayers);

    // A state that does not start at rest is reached in a lead-in.
    const bool offset = after_event || frames.front() > 0 || !s.pressure_pa.empty() || !s.gravity_m_s2.empty() ||
                        !s.far_motion_m.empty() ||
                        std::any_of(s.patch_loads.begin(), s.patch_loads.end(),
                                    [&](const PatchLoad& load) { return norm(load.force_n[frames.front()]) > 0.0; });
    const bool dynamic = options_.dynamic && !linear;
    const double lead = offset && !dynamic ? kLead : 0.0, dt = nominal_.dt_s;
    const auto curve = [&](const auto& value) { return frame_curve(lead, dt, frames, value); };

    CalculixRecording r;
    r.nodes = mesh.nodes();
    r.dynamic = dynamic;
    r.large_displacements = !linear;
    r.max_increment_s = linear ? lead : dynamic ? 0.5 * dt : dt;
    const auto tets = mesh.tets10();
    calculix::Part body{calculix::Part::Element::kTet10, {}, s.body},
        inclusion{calculix::Part::Element::kTet10, {}, s.inclusion};
    std::vector<std::int32_t> number_in_body(tets.size(), -1);
    for (std::size_t t = 0; t < tets.size(); ++t) {
        const bool other = !s.in_inclusion.empty() && s.in_inclusion[t] != 0;
        if (!other) number_in_body[t] = static_cast<std::int32_t>(body.elements.size());
        (other ? inclusion : body).elements.push_back(tets[t]);
    }
    r.parts.push_back(std::move(body));
    if (!inclusion.elements.empty()) r.parts.push_back(std::move(inclusion));
    if (s.prony_ratio > 0.0) {  // tau = eta / G, deviatoric rate 3/2 A s: A = 1 / (3 G tau)
        CalculixMaterial branch{.law = CalculixMaterial::Law::kLinear,
                                .youngs_modulus_pa = s.prony_ratio * s.body.youngs_modulus_pa,
                                .poissons_ratio = 0.3};
        branch.creep_per_pa_s = 1.0 / (3.0 * branch.shear_modulus_pa() * s.prony_time_s);
        r.parts.push_back({calculix::Part::Element::kTet10, tets, branch});
    }
    if (!band.wedges.empty()) r.parts.push_back({calculix::Part::Element::kWedge15, band.wedges, s.ligament});
    if (!extra.wedges.empty()) r.parts.push_back({calculix::Part::Element::kWedge15, extra.wedges, s.ligament});

    if (s.far_motion_m.empty()) {
        if (!band.far_nodes.empty()) add_support(r, band.far_nodes);
    } else {
        for (int axis = 0; axis < 3; ++axis)
            r.supports.push_back({band.far_nodes, axis, curve([&](std::size_t k) {
                                      return s.far_motion_m[k][static_cast<std::size_t>(axis)];
                                  })});
    }
    if (!extra.far_nodes.empty()) add_support(r, extra.far_nodes);
    if (s.clamp_held && !clamp_.empty()) add_support(r, nodes_of(mesh, clamp_));

    // Patches may overlap and CalculiX wants one curve a node and axis: forces are summed per node.
    std::map<std::int32_t, std::vector<Point>> node_force;  // [frame]
    const auto add_patch = [&](const PatchLoad& patch, const auto& force) {
        const auto shares = patch.at.empty()
                                ? patch_weights(mesh.corners(), mesh.surface(), &mesh, patch.centre_m, patch.radius_m)
                                : point_weights(mesh, patch.at);
        for (const auto& [node, share] : shares) {
            auto& total = node_force.try_emplace(node, num_frames()).first->second;
            for (const std::size_t k : frames) total[k] = plus(total[k], times(share, force(k)));
        }
    };
    for (std::size_t region = 0; region < regions_.size() && !linear; ++region)
        add_patch(regions_[region], [&](std::size_t k) { return s.forces_n[k][region]; });
    for (const PatchLoad& load : s.patch_loads) add_patch(load, [&](std::size_t k) { return load.force_n[k]; });
    for (const auto& [node, force] : node_force)
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Point unit{};
            unit[axis] = 1.0;
            const auto& along = force;
            r.loads.push_back({{{node, unit}}, curve([&](std::size_t k) { return along[k][axis]; })});
        }
    if (!s.pressure_pa.empty()) {
        calculix::FacePressure pressure{{}, curve([&](std::size_t k) { return s.pressure_pa[k]; })};
        for (const std::int32_t t : mesh.find(s.pressed)) {
            std::array<std::int32_t, 3> face = element_face(mesh, static_cast<std::size_t>(t));
            face[1] = number_in_body[static_cast<std::size_t>(face[1])];
            if (face[1] >= 0) pressure.faces.push_back(face);
        }
        r.pressures.push_back(std::move(pressure));
    }
    if (!s.gravity_m_s2.empty())
        r.body_forces.push_back({s.gravity_direction, curve([&](std::size_t k) { return s.gravity_m_s2[k]; })});
    for (const SpringBed& bed : s.beds)
        for (const auto& [node, area] : node_areas(mesh, bed.facets)) {
            if (bed.ground_n_per_m3 > 0.0) {
                const double k = bed.ground_n_per_m3 * area;
                r.ground_springs.push_back({node, {k, k, k}});
                continue;
            }
            const Point& p = mesh.nodes()[static_cast<std::size_t>(node)];
            calculix::LineSpring line{node, plus(p, times(bed.line_m, shape_->normal(p))), {}};
            for (const auto& [elongation, stress] : bed.elongation_stress)
                line.elongation_force.emplace_back(elongation, stress * area);
            r.line_springs.push_back(std::move(line));
        }
    for (const auto& [where, mass] : s.hung_kg)
        for (const auto& [node, share] : patch_weights(mesh.corners(), mesh.surface(), &mesh, where, kPatchRadius))
            if (share > 0.0) r.masses_kg.emplace_back(node, share * mass);

    std::vector<QuadraticPoint> samples;
    for (const auto* rest : {&nominal_.markers, &nominal_.validation_rest})
        for (const MarkerRest& m : *rest) {
            samples.push_back(in_body(mesh, m.position_m));
            // the truth's mesh has a surface of its own
            if (samples.back().weights.empty() && options_.given) samples.back() = on_surface(mesh, m.position_m);
        }
    for (const QuadraticPoint& sample : samples) {
        if (sample.weights.empty()) return not_usable("a marker or point lies outside the truth's mesh");
        for (const auto& [node, weight] : sample.weights) r.output_nodes.push_back(node);
    }
    std::sort(r.output_nodes.begin(), r.output_nodes.end());
    r.output_nodes.erase(std::unique(r.output_nodes.begin(), r.output_nodes.end()), r.output_nodes.end());
    const bool starts_at_rest = lead == 0.0;
    for (std::size_t k = starts_at_rest ? 1 : 0; k < frames.size(); ++k)
        r.times_s.push_back(lead + static_cast<double>(k) * dt);

    TERES_TRY_ASSIGN(const calculix::RecordingSolution solution, solve_recording(r, scratch, kSolverLimit));
    Motion motion;
    motion.solver_s = solution.seconds;
    std::map<std::int32_t, Point> rest;
    for (const std::int32_t node : r.output_nodes) rest[node] = Point{};
    for (std::size_t k = 0; k < frames.size(); ++k) {
        const auto& u = starts_at_rest ? (k == 0 ? rest : solution.displacement_m[k - 1]) : solution.displacement_m[k];
        std::size_t next = 0;
        for (auto [list, out] :
             {std::pair{&nominal_.markers, &motion.markers}, std::pair{&nominal_.validation_rest, &motion.points}}) {
            out->emplace_back();
            for (const MarkerRest& m : *list) out->back().push_back(moved(samples[next++], m.position_m, u));
        }
    }
    return motion;
}

}  // namespace teres::blindtest
