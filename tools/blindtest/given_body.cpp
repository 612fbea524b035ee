// A patient about a given case: what the modeller believes is the case, what is true is drawn within it.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/case/geometry.h"
#include "core/case/load_tracks.h"
#include "tools/blindtest/truth_body.h"

namespace teres::blindtest {
namespace {

constexpr double kShift = 0.004;          // [m] of the attachment against the prior, at most, per axis
constexpr std::size_t kFewestFacets = 4;  // of an attachment

// The direction in which points spread most, towards +y, so that the same points always give the same.
Point principal_direction(const Facets& points) {
    if (points.empty()) return {0.0, 1.0, 0.0};
    const Eigen::Map<const Eigen::Matrix3Xd> at(points.front().data(), 3, static_cast<Eigen::Index>(points.size()));
    const Eigen::Matrix3Xd about = at.colwise() - at.rowwise().mean();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(about * about.transpose());  // ascending
    const Eigen::Vector3d axis = spread.eigenvectors().col(2) * (spread.eigenvectors()(1, 2) < 0.0 ? -1.0 : 1.0);
    return {axis.x(), axis.y(), axis.z()};
}

}  // namespace

Status check_given(const Case& given) {
    const std::string where = given.folder.string() + ": ";
    if (!given.tools.empty() || !given.springs.empty())
        return invalid_input(where + "blind cases of a body with tools or springs of its own cannot be made");
    if (norm(given.gravity_m_s2) > 0.0) return invalid_input(where + "gravity_m_s2 must be 0 for blind cases");
    if (given.sensor.latency_s != 0.0) return invalid_input(where + "sensor.latency_s must be 0 for blind cases");
    if (!given.sensor.camera_position_m || !given.sensor.view_direction)
        return invalid_input(where + "blind cases need sensor.camera_position_m and sensor.view_direction");
    if (given.loads.empty()) return invalid_input(where + "blind cases need loads (loads.csv)");
    const bool held = given.ligament && given.ligament->youngs_modulus_pa > 0.0 && !given.ligament_prior.empty();
    if (!held && given.clamped.empty())
        return invalid_input(where + "blind cases need a ligament (modulus and prior) or a clamp");
    return {};
}

// Facets whose prior probability, looked up after a small shift, is above a drawn threshold; along the strip.
Facets TruthBody::draw_attachment(const Case& given, const MeshShape& shape, Random& random) const {
    std::map<std::int32_t, double> prior;
    double most = 0.0;
    for (const NodeProbability& p : given.ligament_prior) {
        prior[p.node_id] = p.probability;
        most = std::max(most, p.probability);
    }
    const Point shift{random.uniform(-kShift, kShift), random.uniform(-kShift, kShift),
                      random.uniform(-kShift, kShift)};
    const auto probability = [&](const Point& c) {
        const SurfacePoint at = shape.surface().closest(minus(c, shift));
        double sum = 0.0;
        for (std::size_t i = 0; i < 3; ++i) {
            const auto found = prior.find(shape.surface().triangles()[static_cast<std::size_t>(at.triangle)][i]);
            if (found != prior.end()) sum += at.barycentric[i] * found->second;
        }
        return sum;
    };
    Facets chosen;
    for (double least = random.uniform(0.35, 0.75) * most; chosen.size() < kFewestFacets && least > 0.02 * most;
         least *= 0.8)
        chosen = facets([&](const Point& c, const Point&) { return probability(c) > least; });
    const Point along = principal_direction(chosen);
    std::sort(chosen.begin(), chosen.end(),
              [&](const Point& a, const Point& b) { return dot(a, along) < dot(b, along); });
    return chosen;
}

Status TruthBody::take(const Case& given, const MeshShape& shape, Random& random) {
    nominal_ = given;
    nominal_.observations.clear();
    nominal_.stream.clear();
    options_.frames = given.num_frames;
    const BodyData& body = given.body;
    control_.body = draw_law(body.youngs_modulus_pa, body.poissons_ratio, random);
    if (body.density_kg_m3 > 0.0) control_.body.density_kg_m3 = body.density_kg_m3;
    if (given.ligament && !given.ligament_prior.empty()) {
        true_band_.height_m = given.ligament->height_m;
        true_band_.poissons_ratio = given.ligament->poissons_ratio;
        true_band_.youngs_modulus_pa = given.ligament->youngs_modulus_pa * random.log_uniform(0.6, 1.6);
        control_.ligament = {.law = calculix::CalculixMaterial::Law::kNeoHookean,
                             .youngs_modulus_pa = true_band_.youngs_modulus_pa,
                             .poissons_ratio = true_band_.poissons_ratio};
        if (options_.dynamic) control_.ligament.density_kg_m3 = control_.body.density_kg_m3;
        control_.band = draw_attachment(given, shape, random);
        if (control_.band.size() < kFewestFacets)
            return not_usable("the prior covers fewer than " + std::to_string(kFewestFacets) + " facets of the truth");
    }
    std::vector<char> held(given.mesh.nodes.size(), 0);
    for (const std::int32_t node : given.clamped) held[static_cast<std::size_t>(node)] = 1;
    clamp_ = facets([&](const Point& c, const Point&) {
        const auto& at = shape.surface().triangles()[static_cast<std::size_t>(shape.surface().closest(c).triangle)];
        return std::all_of(at.begin(), at.end(),
                           [&](std::int32_t n) { return held[static_cast<std::size_t>(n)] != 0; });
    });
    if (!given.clamped.empty() && clamp_.empty()) return not_usable("the clamp covers no facet of the truth");

    control_.forces_n.assign(num_frames(), std::vector<Point>(given.load_regions.size()));
    for (const LoadRegion& region : given.load_regions) {
        PatchLoad patch;
        for (std::size_t i = 0; i < region.node_ids.size(); ++i) {
            const Point& p = given.mesh.nodes[static_cast<std::size_t>(region.node_ids[i])];
            patch.at.emplace_back(p, region.weights[i]);
            patch.centre_m = plus(patch.centre_m, times(region.weights[i], p));
        }
        for (const auto& [p, share] : patch.at) patch.radius_m = std::max(patch.radius_m, distance(p, patch.centre_m));
        patch.centre_m = mesh_.surface().closest(patch.centre_m).position_m;
        regions_.push_back(std::move(patch));
    }
    const LoadTracks tracks(given);
    tool_loads_t loads;
    for (std::size_t k = 0; k < num_frames(); ++k) {
        tracks.at(time_s(k), loads);
        for (std::size_t r = 0; r < regions_.size(); ++r)
            control_.forces_n[k][r] = {loads.fx_n[r], loads.fy_n[r], loads.fz_n[r]};
    }
    if (nominal_.markers.empty() || nominal_.validation_rest.empty()) place_samples(random);
    return {};
}

}  // namespace teres::blindtest
