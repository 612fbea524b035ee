#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "core/case/geometry.h"
#include "tools/blindtest/effect_draws.h"

namespace teres::blindtest {
namespace {

constexpr double kPi = std::numbers::pi;
using Law = calculix::CalculixMaterial::Law;

struct Draw {
    Random& random;
    const TruthBody& body;
    Scenario& s;
    const std::filesystem::path& scratch;
    EffectTruth truth{};

    std::size_t frames() const { return body.num_frames(); }
    double end_s() const { return body.time_s(frames() - 1); }
    Point surface_point(const Point& towards, double wander) {
        const Point d = plus(towards, times(wander, random.direction()));
        return body.shape().exit(body.shape().centre(), times(1.0 / norm(d), d));
    }
    /// A surface point in front or at the side, clear of ligament and clamp.
    Point free_place() {
        for (int i = 0; i < 200; ++i) {
            const Point p = surface_point({0.0, 0.0, 0.4}, 1.0);
            const auto clear = [&](const Facets& facets) {
                return std::all_of(facets.begin(), facets.end(),
                                   [&](const Point& f) { return distance(f, p) > 0.035; });
            };
            if (p[2] > -0.02 && clear(s.band) && clear(body.clamp())) return p;
        }
        return surface_point({-0.8, -0.4, 0.5}, 0.1);
    }
    Facets disk(const Point& centre, double radius) const {
        return body.facets([&](const Point& c, const Point&) { return distance(c, centre) < radius; });
    }
    /// Factor that makes the extra loads of `only` at `frame` move the markers by a drawn rms.
    Result<double> size(const Scenario& only, std::size_t frame) {
        const double target_m = random.log_uniform(0.0007, 0.005);
        TERES_TRY_ASSIGN(const double unit, body.linear_rms(only, frame, scratch));
        truth.parameters["linear_rms_m"] = target_m;
        return target_m / unit;
    }
    void place(const Point& centre, double radius) {
        truth.center_m = centre;
        truth.radius_m = radius;
    }
    std::size_t event() {
        const auto frame = static_cast<std::size_t>(random.uniform(0.35, 0.6) * static_cast<double>(frames()));
        s.event_frame = static_cast<int>(frame);
        if (s.band_after.empty()) s.band_after = s.band;
        truth.onset_s = body.time_s(frame);
        return frame;
    }
};

// One-sided law f = slope * w ln(1 + exp((x - start) / w)): zero well below `start`, a straight line well above.
// Rounded, because Newton's steps of many springs with a sharp corner chase one another; where it starts within some w
// of rest, it pushes at rest.
std::vector<std::pair<double, double>> one_sided(double start_m, double slope, double sign, double width_m = 0.0007) {
    std::vector<std::pair<double, double>> table;
    const auto add = [&](double x, double f) { table.emplace_back(sign * (start_m + x), sign * slope * f); };
    add(-0.1, 0.0);
    for (const double x : {-8.6, -5.7, -4.3, -2.9, -2.1, -1.4, -0.7, 0.0, 0.7, 1.4, 2.1, 2.9, 4.3, 5.7})
        add(x * width_m, width_m * std::log1p(std::exp(x)));
    add(0.1, 0.1);
    if (sign < 0.0) std::reverse(table.begin(), table.end());
    return table;
}

Status stiffness(Draw& d) {
    const double ratio = std::exp(d.random.sign() * d.random.uniform(0.2, 0.8));
    d.s.body.youngs_modulus_pa *= ratio;
    d.s.body.yeoh_c20_pa *= ratio;
    d.truth.parameters["ratio"] = ratio;
    return {};
}

Status inclusion(Draw& d) {  // sharp ellipsoid
    const TetMeshData& mesh = d.body.mesh().corners();
    const double ratio = d.random.chance(0.75) ? d.random.log_uniform(4.0, 10.0) : d.random.log_uniform(0.12, 0.3);
    for (int i = 0; i < 50; ++i) {
        const Point rim = d.free_place();
        const Point centre = minus(rim, times(d.random.uniform(0.016, 0.026), d.body.shape().normal(rim)));
        const Point axes{d.random.uniform(0.018, 0.028), d.random.uniform(0.018, 0.028),
                         d.random.uniform(0.018, 0.028)};
        std::vector<char> in(mesh.tets.size(), 0);
        double volume = 0.0;
        Point middle{};
        for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
            Point c{};
            for (const std::int32_t node : mesh.tets[t])
                c = plus(c, times(0.25, mesh.nodes[static_cast<std::size_t>(node)]));
            double q = 0.0;
            for (std::size_t a = 0; a < 3; ++a) q += std::pow((c[a] - centre[a]) / axes[a], 2);
            if (q > 1.0) continue;
            in[t] = 1;
            volume += signed_volume_m3(mesh, t);
            middle = plus(middle, times(signed_volume_m3(mesh, t), c));
        }
        if (std::count(in.begin(), in.end(), 1) < 3) continue;
        d.s.in_inclusion = in;
        d.s.inclusion = d.s.body;
        d.s.inclusion.youngs_modulus_pa *= ratio;
        d.s.inclusion.yeoh_c20_pa *= ratio;
        d.truth.parameters["ratio"] = ratio;
        d.truth.parameters["volume_m3"] = volume;
        d.place(times(1.0 / volume, middle), std::cbrt(0.75 * volume / kPi));
        return {};
    }
    return not_usable("no place for an inclusion");
}

Status viscoelasticity(Draw& d) {  // Maxwell branch; the long-term modulus is the nominal one
    d.s.prony_ratio = d.random.uniform(0.5, 1.7);
    d.s.prony_time_s = d.random.log_uniform(0.5, 5.0);
    d.truth.parameters["ratio"] = d.s.prony_ratio;
    d.truth.parameters["time_s"] = d.s.prony_time_s;
    return {};
}

Status material_law(Draw& d) {  // much stiffer when stretched
    d.s.body.law = d.random.chance(0.5) ? Law::kYeoh : Law::kOgden;
    d.s.body.yeoh_c20_pa = d.random.log_uniform(2.0, 12.0) * d.s.body.shear_modulus_pa();
    d.s.body.alpha = d.random.uniform(12.0, 22.0);
    if (d.s.body.law == Law::kYeoh)
        d.truth.parameters["c20_over_g"] = d.s.body.yeoh_c20_pa / d.s.body.shear_modulus_pa();
    else
        d.truth.parameters["alpha"] = d.s.body.alpha;
    return {};
}

Status compressibility(Draw& d) {
    d.s.body.poissons_ratio = d.random.uniform(0.22, 0.40);
    d.truth.parameters["poissons_ratio"] = d.s.body.poissons_ratio;
    return {};
}

// A Maxwell branch that relaxes faster than the body swings damps like ratio x time of Rayleigh's share of the
// stiffness. (*DAMPING of CalculiX 2.20 changes nothing in implicit nonlinear dynamics.)
Status damping(Draw& d) {
    d.s.prony_ratio = d.random.uniform(0.5, 1.5);
    d.s.prony_time_s = d.random.log_uniform(0.02, 0.04);
    d.truth.parameters["rayleigh_stiffness_s"] = d.s.prony_ratio * d.s.prony_time_s;
    return {};
}

Status inertia(Draw& d) {  // a mass hung at a loaded place
    const PatchLoad& region = d.body.regions()[d.random.index(d.body.regions().size())];
    const double mass = d.random.log_uniform(0.03, 0.25);
    d.s.hung_kg.emplace_back(region.centre_m, mass);
    d.truth.parameters["mass_kg"] = mass;
    d.place(region.centre_m, region.radius_m);
    return {};
}

Status cut(Draw& d) {
    for (int i = 0; i < 50; ++i) {
        const Point centre = d.free_place();
        const Point normal = d.body.shape().normal(centre);
        Point across = cross(normal, d.random.direction());
        across = times(1.0 / norm(across), across);
        const double radius = d.random.uniform(0.032, 0.048), bowl = d.random.uniform(0.04, 0.12);
        const double bend = (d.random.chance(0.5) ? 1.0 : -1.0) / bowl;
        TruthMesh copy = d.body.mesh();
        const std::size_t faces = copy.cut(centre, across, bend, radius);
        if (faces < 6) continue;
        d.event();
        d.s.cut_centre_m = centre;
        d.s.cut_normal = across;
        d.s.cut_bend_1_m = bend;
        d.s.cut_radius_m = radius;
        d.truth.parameters["faces"] = faces;
        d.truth.parameters["bend_1_m"] = bend;
        d.place(minus(centre, times(0.4 * radius, normal)), radius);
        return {};
    }
    return not_usable("no place for a cut");
}

Status extra_attachment(Draw& d) {
    const Point centre = d.free_place();
    const double radius = d.random.uniform(0.016, 0.024);
    const Facets facets = d.disk(centre, radius);
    if (facets.size() < 2) return not_usable("adhesion covers no facet");
    if (d.random.chance(0.5)) {  // a second ligament
        d.s.extra_band = facets;
        d.truth.parameters["form"] = "band";
    } else {
        double area = 0.0;
        for (const std::int32_t t : d.body.mesh().find(facets)) area += d.body.mesh().area(static_cast<std::size_t>(t));
        const double stiffness = d.random.log_uniform(25.0, 600.0);
        d.s.beds.push_back({facets, stiffness / area, 0.0, {}});
        d.truth.parameters["form"] = "springs";
        d.truth.parameters["stiffness_n_per_m"] = stiffness;
    }
    d.place(centre, radius);
    return {};
}

Status ligament_slack(Draw& d) {  // strings that first pull after a dead zone, in place of the band
    const double slack = d.random.uniform(0.002, 0.010), height = d.body.true_band().height_m;
    const double slope = d.s.ligament.youngs_modulus_pa / height;  // [Pa/m]
    d.s.beds.push_back({d.s.band, 0.0, height, one_sided(slack, slope, 1.0)});
    d.s.band.clear();
    d.truth.parameters["slack_m"] = slack;
    return {};
}

Status ligament_tear(Draw& d) {
    const double share = d.random.uniform(0.3, 0.65);
    d.event();
    const auto gone = static_cast<std::ptrdiff_t>(std::ceil(share * static_cast<double>(d.s.band.size())));
    const bool front = d.random.chance(0.5);
    if (static_cast<std::size_t>(gone) >= d.s.band.size()) return not_usable("the tear leaves no ligament");
    d.s.band_after =
        front ? Facets(d.s.band.begin() + gone, d.s.band.end()) : Facets(d.s.band.begin(), d.s.band.end() - gone);
    Point centre{};
    for (std::ptrdiff_t i = 0; i < gone; ++i)
        centre = plus(centre, times(1.0 / static_cast<double>(gone),
                                    front ? d.s.band[static_cast<std::size_t>(i)] : *(d.s.band.end() - 1 - i)));
    d.truth.parameters["share"] = share;
    d.place(centre, 0.02);
    return {};
}

Status moving_attachment(Draw& d) {  // breathing: A (1 - cos^4(pi t / T)), flat in expiration (Lujan)
    const double amplitude = d.random.log_uniform(0.001, 0.007), period = d.random.uniform(3.0, 5.0);
    const Point along{d.random.uniform(-0.2, 0.2), -1.0, d.random.uniform(-0.5, 0.5)};
    for (std::size_t k = 0; k < d.frames(); ++k) {
        const double swing = amplitude * (1.0 - std::pow(std::cos(kPi * d.body.time_s(k) / period), 4));
        d.s.far_motion_m.push_back(times(swing / norm(along), along));
    }
    d.truth.parameters["amplitude_m"] = amplitude;
    d.truth.parameters["period_s"] = period;
    return {};
}

Status clamp_compliance(Draw& d) {
    const double stiffness = d.random.log_uniform(5e4, 1e6);
    d.s.clamp_held = false;
    d.s.beds.push_back({d.body.clamp(), stiffness, 0.0, {}});
    d.truth.parameters["stiffness_n_per_m3"] = stiffness;
    return {};
}

Status contact(Draw& d) {  // springs that only push, beyond a gap; beside a load so that the surface gets there
    const Point& near = d.body.regions()[d.random.index(d.body.regions().size())].centre_m;
    const Point centre = d.surface_point(minus(near, d.body.shape().centre()), 0.02);
    const double radius = d.random.uniform(0.020, 0.030), gap = d.random.uniform(0.0, 0.0015);
    constexpr double kPush = 3e6, kFar = 0.2, kWidth = 0.0002;  // [Pa/m], [m]
    constexpr double kClear = 3.0 * kWidth;  // of its rounded begin: at rest it pushes with 30 Pa at most
    const Facets facets = d.disk(centre, radius);
    if (facets.size() < 2) return not_usable("contact covers no facet");
    d.s.beds.push_back({facets, 0.0, kFar, one_sided(gap + kClear, kPush, -1.0, kWidth)});
    d.truth.parameters["gap_m"] = gap + kClear;
    d.place(centre, radius);
    return {};
}

Status gravity(Draw& d) {
    const Point g = d.random.direction();
    d.s.gravity_direction = g;
    d.s.gravity_m_s2.assign(d.frames(), 1.0);
    TERES_TRY_ASSIGN(const double size, d.size(d.s, 0));
    d.s.gravity_m_s2.assign(d.frames(), size);
    d.truth.parameters["gravity_m_s2"] = times(size, g);
    return {};
}

Status pressure(Draw& d) {  // on the front, steady or rising
    const Facets all = d.body.facets([](const Point&, const Point& normal) { return normal[2] > 0.3; });
    for (const Point& f : all)
        if (std::none_of(d.s.band.begin(), d.s.band.end(), [&](const Point& b) { return distance(b, f) < 1e-9; }))
            d.s.pressed.push_back(f);
    d.s.pressure_pa.assign(d.frames(), 1.0);
    TERES_TRY_ASSIGN(const double size, d.size(d.s, 0));
    const double start = d.random.chance(0.5) ? 1.0 : d.random.uniform(0.6, 0.9);
    for (std::size_t k = 0; k < d.frames(); ++k)
        d.s.pressure_pa[k] = size * (start + (1.0 - start) * d.body.time_s(k) / d.end_s());
    d.truth.parameters["pressure_pa"] = size;
    d.truth.parameters["start_share"] = start;
    return {};
}

Status load_scale(Draw& d) {
    const std::size_t region = d.random.index(d.body.regions().size());
    const double gain = 1.0 + d.random.sign() * d.random.uniform(0.15, 0.6);
    const Point axis = d.random.direction();
    const double turn = d.random.uniform(0.0, 0.12);
    for (auto& forces : d.s.forces_n)
        forces[region] = times(gain, plus(forces[region], times(turn, cross(axis, forces[region]))));
    d.truth.parameters["region"] = d.body.nominal().load_regions[region].name;
    d.truth.parameters["gain"] = gain;
    d.truth.parameters["turn_rad"] = turn;
    d.place(d.body.regions()[region].centre_m, d.body.regions()[region].radius_m);
    return {};
}

Status unknown_load(Draw& d) {  // a tool that comes, wavers and goes
    const Point centre = d.free_place();
    const double radius = d.random.uniform(0.016, 0.026);
    const Point along = d.random.direction();
    const double on = d.random.uniform(0.2, 0.5) * d.end_s(),
                 off = d.random.chance(0.5) ? d.end_s() + 1.0 : on + d.random.uniform(0.3, 0.5) * d.end_s();
    const double waver = d.random.uniform(1.8, 3.0);
    PatchLoad load{centre, radius, std::vector<Point>(d.frames())};
    std::size_t peak = 0;
    for (std::size_t k = 0; k < d.frames(); ++k) {
        const double t = d.body.time_s(k), edge = 0.03 * d.end_s();
        const double window = 1.0 / (1.0 + std::exp(-(t - on) / edge)) / (1.0 + std::exp((t - off) / edge));
        if (window > 0.01) load.force_n[k] = times(window * (1.0 + 0.25 * std::sin(2.0 * kPi * t / waver)), along);
        if (norm(load.force_n[k]) > norm(load.force_n[peak])) peak = k;
    }
    Scenario only = d.body.control();
    only.patch_loads = {load};
    TERES_TRY_ASSIGN(const double size, d.size(only, peak));
    for (Point& f : load.force_n) f = times(size, f);
    d.s.patch_loads.push_back(load);
    d.truth.parameters["force_n"] = times(size, along);
    d.truth.parameters["off_s"] = off;
    d.truth.onset_s = on;
    d.place(centre, radius);
    return {};
}

Status cardiac(Draw& d) {  // beats with a harmonic, under the diaphragm over the left lobe
    const Point centre = d.surface_point({0.5, 0.8, 0.0}, 0.1);
    const double rate = d.random.uniform(0.95, 1.45), share = d.random.uniform(0.2, 0.45),
                 phase = d.random.uniform(0.0, 6.0);
    PatchLoad load{centre, 0.03, {}};
    const Point inwards = times(-1.0, d.body.shape().normal(centre));
    std::size_t peak = 0;
    for (std::size_t k = 0; k < d.frames(); ++k) {
        const double angle = 2.0 * kPi * rate * d.body.time_s(k) + phase;
        load.force_n.push_back(times(std::sin(angle) + share * std::sin(2.0 * angle + 0.7), inwards));
        if (norm(load.force_n[k]) > norm(load.force_n[peak])) peak = k;
    }
    Scenario only = d.body.control();
    only.patch_loads = {load};
    TERES_TRY_ASSIGN(const double size, d.size(only, peak));
    for (Point& f : load.force_n) f = times(size, f);
    d.s.patch_loads.push_back(load);
    d.truth.parameters["rate_hz"] = rate;
    d.truth.parameters["force_n"] = size;
    d.place(centre, load.radius_m);
    return {};
}

}  // namespace

const std::vector<EffectKind>& effect_kinds() {
    static const std::vector<EffectKind> kinds{
        {"stiffness", "mechanics", "tissue response", false, false, false},
        {"inclusion", "mechanics", "local stiffness", false, false, false},
        {"viscoelasticity", "mechanics", "tissue response", false, false, false},
        {"material_law", "mechanics", "tissue response", false, false, false},
        {"compressibility", "mechanics", "compressibility", false, false, false},
        {"damping", "mechanics", "damping", false, true, false},
        {"inertia", "mechanics", "inertia", false, true, false},
        {"cut", "mechanics", "local stiffness", false, false, true},
        {"extra_attachment", "boundary", "one-sided or extra support", false, false, false},
        {"ligament_slack", "boundary", "ligament state", true, false, false},
        {"ligament_tear", "boundary", "ligament state", false, false, true},
        {"moving_attachment", "boundary", "moving_attachment", false, false, false},
        {"clamp_compliance", "boundary", "clamp_compliance", true, false, false},
        {"contact", "boundary", "one-sided or extra support", false, false, false},
        {"gravity", "load", "steady load", false, false, false},
        {"pressure", "load", "steady load", false, false, false},
        {"load_scale", "load", "load_scale", false, false, false},
        {"unknown_load", "load", "unknown_load", false, false, true},
        {"cardiac", "load", "cardiac", false, false, false},
        {"registration", "sensor", "sensor offset", false, false, false},
        {"depth_scale", "sensor", "sensor offset", false, false, false},
        {"latency", "sensor", "latency", false, false, false},
        {"camera_drift", "sensor", "camera_drift", false, false, false},
        {"lens_distortion", "sensor", "lens_distortion", false, false, false},
        {"marker_slip", "sensor", "marker_slip", false, false, true},
        {"noise", "sensor", "noise", false, false, false}};
    return kinds;
}

const EffectKind* find_effect(const std::string& id) {
    for (const EffectKind& kind : effect_kinds())
        if (id == kind.id) return &kind;
    return nullptr;
}

Result<EffectTruth> draw_mechanics(const std::string& id, Random& random, const TruthBody& body, Scenario& scenario,
                                   const std::filesystem::path& scratch) {
    static const std::map<std::string, Status (*)(Draw&)> draws{{"stiffness", stiffness},
                                                                {"inclusion", inclusion},
                                                                {"viscoelasticity", viscoelasticity},
                                                                {"material_law", material_law},
                                                                {"compressibility", compressibility},
                                                                {"damping", damping},
                                                                {"inertia", inertia},
                                                                {"cut", cut},
                                                                {"extra_attachment", extra_attachment},
                                                                {"ligament_slack", ligament_slack},
                                                                {"ligament_tear", ligament_tear},
                                                                {"moving_attachment", moving_attachment},
                                                                {"clamp_compliance", clamp_compliance},
                                                                {"contact", contact},
                                                                {"gravity", gravity},
                                                                {"pressure", pressure},
                                                                {"load_scale", load_scale},
                                                                {"unknown_load", unknown_load},
                                                                {"cardiac", cardiac}};
    const auto found = draws.find(id);
    if (found == draws.end()) return invalid_input("'" + id + "' is no mechanical effect");
    Draw draw{random, body, scenario, scratch};
    draw.truth.id = id;
    TERES_TRY(found->second(draw));
    return draw.truth;
}

}  // namespace teres::blindtest
