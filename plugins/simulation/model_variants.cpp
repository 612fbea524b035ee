#include "plugins/simulation/model_variants.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "core/case/surface.h"

namespace teres {
namespace {

// Where the default model's body is, for a model with the same corners and perhaps mid-edge nodes.
ScenePlayer::Guess from_nominal(const CaseModel& model, std::span<const Eigen::VectorXd> nominal) {
    const auto nodes = static_cast<Eigen::Index>(model.num_nodes());
    std::vector<std::array<NodeIndex, 2>> edges;  // of mid-edge nodes
    if (!nominal.empty() && 3 * nodes > nominal.front().size()) edges = make_quadratic(model.mesh()).edge;
    return [&model, nominal, nodes, edges = std::move(edges)](std::size_t f, double* x) {
        const auto& parts = model.system().parts();
        Eigen::Map<Positions> to(x, 3, nodes);
        const Eigen::VectorXd& from = nominal[f];
        std::copy_n(from.data(), std::min(from.size(), to.size()), x);
        auto middle = nodes - static_cast<Eigen::Index>(edges.size());
        for (const auto& [a, b] : edges) to.col(middle++) = 0.5 * (to.col(a) + to.col(b));
        for (Eigen::Index i = 0; i < nodes; ++i)
            if (parts.held[static_cast<std::size_t>(i)]) to.col(i) = parts.X.col(i);
    };
}

// Surface neighbours of clamped nodes are clamped, too.
void widen_clamps(Case& c) {
    const std::set<std::int32_t> held(c.clamped.begin(), c.clamped.end());
    std::set<std::int32_t> wider = held;
    const Surface surface(c.mesh);
    for (const auto& triangle : surface.triangles())
        if (std::any_of(triangle.begin(), triangle.end(), [&](std::int32_t node) { return held.contains(node); }))
            wider.insert(triangle.begin(), triangle.end());
    c.clamped.assign(wider.begin(), wider.end());
}

}  // namespace

std::vector<ModelVariant> model_variants(const Case& c, const PlayerSettings& settings, const Scene& scene) {
    std::vector<ModelVariant> variants;
    const auto add = [&](std::string name, std::function<void(Case&, PlayerSettings&)> change, double share = 1.0) {
        variants.push_back({std::move(name), std::move(change), share});
    };
    const bool dynamic = scene.dynamic;  // 10-node tetrahedra would take minutes for a second of motion
    if (settings.model.element != ElementType::kQuadratic && !dynamic)
        add("10-node tetrahedra", [](Case&, PlayerSettings& s) { s.model.element = ElementType::kQuadratic; });
    add("nodal shear", [](Case&, PlayerSettings& s) { s.model.shear_blend = 0.1; });
    add("element shear", [](Case&, PlayerSettings& s) { s.model.shear_blend = 1.0; });
    // Where a clamp ends is known to half an edge of the mesh: a uniform distribution.
    if (!c.clamped.empty() && !dynamic)
        add(
            "wider clamps", [](Case& other, PlayerSettings&) { widen_clamps(other); }, 1.0 / std::sqrt(12.0));
    // The atlas says where a ligament may hold, not with which nodes of a group.
    if (scene.tethers.ligament_end > 0) {
        add("ligament to one side", [](Case&, PlayerSettings& s) { s.model.ligament.lean = 0.5; });
        add("ligament to the other side", [](Case&, PlayerSettings& s) { s.model.ligament.lean = -0.5; });
        add("narrow ligament", [](Case&, PlayerSettings& s) { s.model.ligament.sharpness = 2.0; });
    }
    const BodyLaw law = c.body.law;
    if (law != BodyLaw::kNeoHookean)
        add("neo-Hookean", [](Case& other, PlayerSettings&) { other.body.law = BodyLaw::kNeoHookean; });
    if (law != BodyLaw::kStVK)
        add("Saint Venant-Kirchhoff", [](Case& other, PlayerSettings&) { other.body.law = BodyLaw::kStVK; });
    if (law == BodyLaw::kOgden)
        for (const double alpha : {-2.0, 4.0})
            add("Ogden alpha " + std::to_string(static_cast<int>(alpha)),
                [alpha](Case& other, PlayerSettings&) { other.body.alpha = alpha; });
    return variants;
}

TrajectoryReport play_variant(const ModelVariant& variant, const Case& c, const PlayerSettings& settings,
                              const Hypothesis& h, std::span<const std::int32_t> frames,
                              std::span<const Eigen::VectorXd> nominal, std::span<double> markers_m,
                              std::span<double> points_m) {
    Case other = c;
    PlayerSettings other_settings = settings;
    other_settings.soft_clamps = false;
    variant.change(other, other_settings);
    const auto made = ScenePlayer::make(other, other_settings);  // asked once: ten kept ones would take a gigabyte
    if (!made) return {static_cast<std::int32_t>(frames.size()), 0, 1.0};
    ScenePlayer& player = **made;
    const auto effects = make_effects(player.scene());
    if (player.scene().dynamic) return player.play_markers(h, effects, frames, markers_m, points_m);
    // The way from frame to frame may be too far for one step.
    const ScenePlayer::Guess guess = nominal.empty() ? ScenePlayer::Guess{} : from_nominal(player.model(), nominal);
    TrajectoryReport report;  // frame by frame: which of them converges is told
    const auto at = [&](std::span<double> all, std::size_t k) {
        const std::size_t row = all.size() / frames.size();
        return all.subspan(k * row, row);
    };
    for (std::size_t k = 0; k < frames.size(); ++k) {
        const auto markers = at(markers_m, k), points = at(points_m, k);
        const TrajectoryReport one = player.play_markers(h, effects, frames.subspan(k, 1), markers, points, guess);
        if (one.frames_converged == 0)
            for (const auto& out : {markers, points})
                std::fill(out.begin(), out.end(), std::numeric_limits<double>::quiet_NaN());
        report = {report.frames + 1, report.frames_converged + one.frames_converged,
                  std::max(report.relative_residual, one.relative_residual)};
    }
    return report;
}

}  // namespace teres
