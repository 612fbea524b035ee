#include "plugins/simulation/parted_body.h"

#include <algorithm>
#include <array>
#include <map>
#include <numeric>

#include "core/check.h"

namespace teres {

using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr int kSmoothings = 4;

struct Face {
    std::array<std::int32_t, 3> nodes;
    std::array<std::size_t, 2> tets;
};

// Faces between two tetrahedra.
std::vector<Face> inner_faces(const TetMeshData& mesh) {
    std::map<std::array<std::int32_t, 3>, std::size_t> first;
    std::vector<Face> faces;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
        for (std::size_t skip = 0; skip < 4; ++skip) {
            std::array<std::int32_t, 3> nodes{};
            for (std::size_t i = 0, k = 0; i < 4; ++i)
                if (i != skip) nodes[k++] = mesh.tets[t][i];
            std::sort(nodes.begin(), nodes.end());
            const auto [found, added] = first.try_emplace(nodes, t);
            if (!added) faces.push_back({nodes, {found->second, t}});
        }
    return faces;
}

// Sets that are joined one by one.
class Groups {
  public:
    explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
    std::size_t of(std::size_t k) {
        while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
        return k;
    }
    void join(std::size_t a, std::size_t b) { parent_[of(a)] = of(b); }
    std::size_t count() {
        std::size_t roots = 0;
        for (std::size_t k = 0; k < parent_.size(); ++k) roots += of(k) == k;
        return roots;
    }

  private:
    std::vector<std::size_t> parent_;
};

template <class Nodes>
Vector3d centroid(const TetMeshData& mesh, const Nodes& nodes) {
    Vector3d sum = Vector3d::Zero();
    for (const auto node : nodes) sum += Eigen::Map<const Vector3d>(mesh.nodes[static_cast<std::size_t>(node)].data());
    return sum / static_cast<double>(nodes.size());
}

// Faces that open.
std::vector<char> opened(const TetMeshData& mesh, const std::vector<Face>& faces, const Crack& crack) {
    std::vector<char> beyond(mesh.tets.size()), near(faces.size()), open(faces.size(), 0);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
        beyond[t] = (centroid(mesh, mesh.tets[t]) - crack.centre_m).dot(crack.normal) > 0.0;
    for (std::size_t f = 0; f < faces.size(); ++f)
        near[f] = (centroid(mesh, faces[f].nodes) - crack.centre_m).norm() <= crack.radius_m;
    for (int round = 0; round < kSmoothings; ++round) {
        std::vector<int> held(mesh.tets.size(), 0);
        for (std::size_t f = 0; f < faces.size(); ++f) {
            open[f] = near[f] && beyond[faces[f].tets[0]] != beyond[faces[f].tets[1]];
            for (const std::size_t t : faces[f].tets) held[t] += !open[f];
        }
        bool changed = false;
        for (std::size_t t = 0; t < held.size(); ++t)
            if (held[t] == 0 && faces.size() > 1) beyond[t] = !beyond[t], changed = true;
        if (!changed) break;
    }
    return open;
}

}  // namespace

std::optional<PartedMesh> part(const TetMeshData& mesh, const Crack& crack) {
    const std::vector<Face> faces = inner_faces(mesh);
    const std::vector<char> open = opened(mesh, faces, crack);
    Groups whole(mesh.tets.size()), pieces(mesh.tets.size());
    PartedMesh out{mesh, {}, std::vector<double>(mesh.nodes.size(), 0.0)};
    std::vector<char> parted(mesh.nodes.size(), 0);
    for (std::size_t f = 0; f < faces.size(); ++f) {
        const std::array<std::int32_t, 3>& nodes = faces[f].nodes;
        const std::array<std::size_t, 2>& tets = faces[f].tets;
        whole.join(tets[0], tets[1]);
        if (!open[f]) {
            pieces.join(tets[0], tets[1]);
            continue;
        }
        const auto at = [&](std::size_t k) {
            return Eigen::Map<const Vector3d>(mesh.nodes[static_cast<std::size_t>(nodes[k])].data());
        };
        const double area = 0.5 * (at(1) - at(0)).cross(at(2) - at(0)).norm();
        for (const auto node : nodes) {
            parted[static_cast<std::size_t>(node)] = 1;
            out.opened_m2[static_cast<std::size_t>(node)] += area / 3.0;
        }
    }
    const bool none = std::none_of(open.begin(), open.end(), [](char o) { return o != 0; });
    if (none || pieces.count() > whole.count()) return {};

    out.origin.resize(mesh.nodes.size());
    std::iota(out.origin.begin(), out.origin.end(), 0);
    std::vector<std::vector<std::size_t>> around(mesh.nodes.size());
    for (std::size_t t = 0; t < mesh.tets.size(); ++t)
        for (const auto node : mesh.tets[t]) around[static_cast<std::size_t>(node)].push_back(t);
    std::vector<std::vector<std::size_t>> holding(mesh.nodes.size());  // faces that stay
    for (std::size_t f = 0; f < faces.size(); ++f)
        if (!open[f])
            for (const auto node : faces[f].nodes)
                if (parted[static_cast<std::size_t>(node)]) holding[static_cast<std::size_t>(node)].push_back(f);
    for (std::size_t node = 0; node < parted.size(); ++node) {
        if (!parted[node]) continue;
        const auto& tets = around[node];
        const auto slot = [&](std::size_t tet) {
            return static_cast<std::size_t>(std::find(tets.begin(), tets.end(), tet) - tets.begin());
        };
        Groups groups(tets.size());
        for (const std::size_t f : holding[node]) groups.join(slot(faces[f].tets[0]), slot(faces[f].tets[1]));
        std::map<std::size_t, std::vector<std::size_t>> members;
        for (std::size_t k = 0; k < tets.size(); ++k) members[groups.of(k)].push_back(tets[k]);
        const auto largest = std::max_element(members.begin(), members.end(), [](const auto& a, const auto& b) {
            return a.second.size() < b.second.size();
        });
        for (auto group = members.begin(); group != members.end(); ++group) {
            if (group == largest) continue;
            for (const std::size_t t : group->second)
                std::replace(out.mesh.tets[t].begin(), out.mesh.tets[t].end(), static_cast<std::int32_t>(node),
                             static_cast<std::int32_t>(out.mesh.nodes.size()));
            out.mesh.nodes.push_back(Point(mesh.nodes[node]));
            out.origin.push_back(static_cast<std::int32_t>(node));
        }
    }
    return out;
}

std::unique_ptr<PartedBody> PartedBody::make(const Case& whole, const PlayerSettings& settings, const Crack& crack) {
    auto mesh = part(whole.mesh, crack);
    if (!mesh) return nullptr;
    std::unique_ptr<PartedBody> body(new PartedBody());
    body->crack_ = crack;
    body->mesh_ = std::move(*mesh);
    body->case_ = whole;
    body->case_.mesh = body->mesh_.mesh;
    auto player = ScenePlayer::make(body->case_, settings);
    if (!player) return nullptr;
    body->player_ = std::move(*player);
    return body;
}

VectorXd PartedBody::doubled(const VectorXd& whole) const {
    VectorXd x(3 * static_cast<Eigen::Index>(mesh_.origin.size()));
    for (std::size_t i = 0; i < mesh_.origin.size(); ++i)
        x.segment<3>(3 * static_cast<Eigen::Index>(i)) = whole.segment<3>(3 * mesh_.origin[i]);
    return x;
}

std::vector<VectorXd> PartedBody::doubled(std::span<const VectorXd> whole) const {
    std::vector<VectorXd> out;
    out.reserve(whole.size());
    for (const VectorXd& x : whole) out.push_back(doubled(x));
    return out;
}

TrajectoryReport PartedBody::play(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                                  std::span<const std::int32_t> frames, std::span<const VectorXd> whole,
                                  std::span<double> markers_m, std::span<double> points_m, std::span<double> nodes_m,
                                  bool all) {
    CaseModel& model = player_->model();
    const std::size_t markers = 3 * model.num_markers(), points = 3 * model.num_points(),
                      nodes = 3 * mesh_.opened_m2.size(), dofs = 3 * model.num_nodes();
    TERES_CHECK(markers_m.size() == frames.size() * markers);
    std::vector<double> state(model.num_state(), 0.0);
    std::optional<std::size_t> last;
    const auto guess = [&](std::size_t f, double* x) {
        if (whole.empty()) return;
        Eigen::Map<VectorXd> at(x, static_cast<Eigen::Index>(dofs));
        at = last ? VectorXd(at + doubled(whole[f] - whole[*last])) : doubled(whole[f]);
        last = f;
    };
    const auto see = [&](std::size_t f, const double* x) {
        const auto k = static_cast<std::size_t>(
            std::lower_bound(frames.begin(), frames.end(), static_cast<std::int32_t>(f)) - frames.begin());
        std::copy_n(x, dofs, state.begin());
        model.observe(state, markers_m.subspan(k * markers, markers), 1);
        if (!points_m.empty()) model.predict_points(state, points_m.subspan(k * points, points));
        if (!nodes_m.empty()) std::copy_n(x, nodes, &nodes_m[k * nodes]);
    };
    return player_->play(h, effects, frames, see, guess, 0, nullptr, all);
}

PartedBody* PartedBodies::by(const Case& whole, const PlayerSettings& settings, const Crack& crack) {
    Crack at = crack;
    at.instant_s = 0.0;  // of no matter to the mesh
    if (asked_ != at) {
        body_ = PartedBody::make(whole, settings, at);
        asked_ = at;
    }
    return body_.get();
}

std::optional<Crack> crack_of(const std::vector<std::unique_ptr<Effect>>& effects, const Hypothesis& h) {
    for (const EffectInstance& on : h.effects) {
        const Effect& effect = *effects[static_cast<std::size_t>(on.index)];
        if (is_null(effect.description(), on.values)) continue;
        if (const std::optional<Crack> crack = effect.crack(on.values)) return crack;
    }
    return {};
}

std::size_t first_parted(const std::vector<double>& times_s, const Crack& crack) {
    return static_cast<std::size_t>(std::lower_bound(times_s.begin(), times_s.end(), crack.instant_s) -
                                    times_s.begin());
}

TrajectoryReport play_in_two(std::span<const std::int32_t> frames, std::size_t first, std::span<double> markers_m,
                             std::span<double> points_m, const FramePlayer& whole, const FramePlayer& parted) {
    const auto before = static_cast<std::size_t>(
        std::lower_bound(frames.begin(), frames.end(), static_cast<std::int32_t>(first)) - frames.begin());
    const auto at = [&](std::span<double> all) { return frames.empty() ? 0 : all.size() / frames.size() * before; };
    TrajectoryReport report{};
    if (before > 0) report = whole(frames.first(before), markers_m.first(at(markers_m)), points_m.first(at(points_m)));
    if (before == frames.size()) return report;
    return both(report,
                parted(frames.subspan(before), markers_m.subspan(at(markers_m)), points_m.subspan(at(points_m))));
}

TrajectoryReport both(const TrajectoryReport& a, const TrajectoryReport& b) {
    return {a.frames + b.frames, a.frames_converged + b.frames_converged,
            std::max(a.relative_residual, b.relative_residual)};
}

TrajectoryReport none_of(std::size_t frames) {
    return {static_cast<std::int32_t>(frames), 0, 1.0};
}

}  // namespace teres
