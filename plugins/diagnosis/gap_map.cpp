#include "plugins/diagnosis/gap_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

namespace teres {
namespace {

constexpr std::size_t kPatches = 40;
constexpr double kForceScale = 0.3;  // N, prior standard deviation of a fictitious force per axis and frame

// Surface nodes far from each other: each next one is the farthest from those chosen.
std::vector<std::int32_t> patch_nodes(const TrajectoryModel& model, std::vector<double>& positions) {
    positions.resize(3 * model.num_nodes());
    model.rest_positions(positions);
    std::vector<std::int32_t> triangles(3 * model.num_surface_triangles());
    model.surface_triangles(triangles);
    std::sort(triangles.begin(), triangles.end());
    triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
    std::vector<std::int32_t> chosen;
    if (triangles.empty()) return chosen;
    const auto at = [&](std::int32_t node) {
        return Eigen::Map<const Eigen::Vector3d>(&positions[3 * static_cast<std::size_t>(node)]);
    };
    std::vector<double> distance(triangles.size(), std::numeric_limits<double>::infinity());
    std::size_t next = 0;
    while (chosen.size() < std::min(kPatches, triangles.size())) {
        chosen.push_back(triangles[next]);
        for (std::size_t k = 0; k < triangles.size(); ++k)
            distance[k] = std::min(distance[k], (at(triangles[k]) - at(chosen.back())).norm());
        next = static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
    }
    return chosen;
}

// Patch whose forces take away most of the residual. The simulator's base must be the nominal fit.
std::optional<std::array<double, 3>> force_map(Simulator& simulator, const Whitener& whitener, const Fit& nominal) {
    const TrajectoryModel& model = simulator.mechanics();
    std::vector<double> positions;
    const auto channels = static_cast<Eigen::Index>(3 * simulator.num_markers());
    const auto rows = static_cast<Eigen::Index>(simulator.num_rows());
    const Eigen::MatrixXd H =
        Eigen::MatrixXd::Identity(nominal.J.cols(), nominal.J.cols()) + nominal.J.transpose() * nominal.J;
    const Eigen::LLT<Eigen::MatrixXd> nuisance(H);
    const auto project = [&](const Eigen::MatrixXd& X) -> Eigen::MatrixXd {
        return X - nominal.J * nuisance.solve(nominal.J.transpose() * X);
    };
    const Eigen::VectorXd r = nominal.residual;
    double best = 0.0;
    std::optional<std::array<double, 3>> place;
    std::vector<double> out(3 * simulator.num_rows());
    for (const std::int32_t node : patch_nodes(model, positions)) {
        if (!model.marker_compliance(node, out)) return std::nullopt;
        // columns: frame and axis
        Eigen::MatrixXd C = Eigen::MatrixXd::Zero(rows, static_cast<Eigen::Index>(3 * simulator.num_frames()));
        for (Eigen::Index row = 0; row < rows; ++row)
            for (Eigen::Index b = 0; b < 3; ++b)
                C(row, 3 * (row / channels) + b) = kForceScale * out[static_cast<std::size_t>(3 * row + b)];
        const Eigen::MatrixXd G = whitener(C);
        const Eigen::MatrixXd S = G.transpose() * project(G);
        const Eigen::VectorXd b = G.transpose() * project(r);
        const Eigen::MatrixXd A = S + Eigen::MatrixXd::Identity(S.rows(), S.cols());
        const double gain = b.dot(A.ldlt().solve(b));
        if (gain > best) {
            best = gain;
            const std::size_t n = 3 * static_cast<std::size_t>(node);
            place = {positions[n], positions[n + 1], positions[n + 2]};
        }
    }
    return place;
}

// Place of the best of what was fitted if that pays and its first effect, which explains most, has a place and is no
// load.
bool place_of_nearest(Simulator& simulator, const Verdict& verdict, Where& where) {
    const Cause* nearest = nullptr;
    for (const Cause& cause : verdict.causes)
        if (cause.fit.usable && cause.score > 0.0 && (nearest == nullptr || cause.score > nearest->score))
            nearest = &cause;
    if (nearest == nullptr) return false;
    const ActiveEffect& first = nearest->fit.at.effects.front();
    const EffectEntry& entry = simulator.effects()[first.entry];
    const auto centre = centre_of(entry, first);
    if (!centre || std::string_view(entry.info.kind) == "load") return false;
    where.center_m = {centre->x(), centre->y(), centre->z()};
    if (Eigen::VectorXd motion; simulator.simulate(nearest->fit.at, motion))
        place_by_forces(simulator, *nearest, where);
    return true;
}

}  // namespace

Where locate(Simulator& simulator, const Whitener& whitener, const Recording& recording, const Fit& nominal,
             const Verdict& verdict, const Cause* named, bool significant) {
    Where where;
    where.marker_share.assign(recording.num_markers, 0.0);
    double total = 0.0;
    for (const Eigen::Index row : recording.seen_rows()) {
        const double d = std::pow(recording.observed(row) - nominal.trajectory(row), 2);
        where.marker_share[recording.marker_of(row)] += d;
        total += d;
    }
    if (total > 0.0)
        for (double& share : where.marker_share) share /= total;
    if (!significant) return where;
    const EffectTable& table = simulator.effects();
    if (named != nullptr) {
        where.kind = table[named->entries[0]].info.kind;
        for (std::size_t k = 0; k < named->entries.size(); ++k) {
            const EffectEntry& entry = table[named->entries[k]];
            const ActiveEffect& effect = named->fit.at.effects[k];
            const double *radius = value_of(entry, effect, "radius"), *onset = value_of(entry, effect, "onset");
            const auto centre = centre_of(entry, effect);
            if (!where.center_m && centre) where.center_m = {centre->x(), centre->y(), centre->z()};
            if (where.radius_m == 0.0 && radius != nullptr) where.radius_m = *radius;
            if (!where.onset_s && onset != nullptr) where.onset_s = *onset;
        }
        if (named->entries.size() == 1) where.other_places = named->other_places;
        return where;
    }
    where.kind = "mechanics";
    if (!place_of_nearest(simulator, verdict, where)) where.center_m = force_map(simulator, whitener, nominal);
    return where;
}

void place_by_forces(const Simulator& simulator, const Cause& named, Where& where) {
    const EffectTable& table = simulator.effects();
    const TrajectoryModel& model = simulator.mechanics();
    std::size_t mechanical = 0;  // index in the hypothesis
    for (std::size_t k = 0; k < named.entries.size(); ++k) {
        const EffectEntry& entry = table[named.entries[k]];
        if (entry.sensor) continue;
        const std::size_t which = mechanical++;
        if (!centre_of(entry, named.fit.at.effects[k])) continue;
        std::vector<double> force_n(model.num_nodes()), rest_m(3 * model.num_nodes());
        if (!model.effect_forces(which, force_n)) return;
        model.rest_positions(rest_m);
        double total = 0.0;
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        for (std::size_t i = 0; i < force_n.size(); ++i) {
            total += force_n[i];
            centre += force_n[i] * Eigen::Map<const Eigen::Vector3d>(&rest_m[3 * i]);
        }
        if (!(total > 0.0)) return;
        centre /= total;
        where.center_m = {centre.x(), centre.y(), centre.z()};
        return;
    }
}

std::string next_experiment(const EffectTable& effects, const Verdict& verdict, const Confusability& confusability,
                            const Calibration& calibration, bool significant) {
    if (verdict.causes.empty()) return "";
    const Cause& top = verdict.causes.front();
    const std::string first = effects[top.entries.back()].info.id;
    if (!significant) return "nothing beyond the floor; to look further: " + separating_experiment(first, "");
    std::string second;
    const auto rivals = confusability.rivals(top.entries.back(), calibration.confusable_overlap);
    if (!rivals.empty()) second = effects[rivals.front()].info.id;
    for (const Cause& cause : verdict.causes)
        if (&cause != &top && cause.entries.size() == 1 && cause.entries[0] != top.entries.back() &&
            cause.probability > 0.05) {
            second = effects[cause.entries[0]].info.id;
            break;
        }
    const std::string text = separating_experiment(first, second);
    return second.empty() ? text + ": confirms " + first : text + " (separates " + first + " from " + second + ")";
}

}  // namespace teres
