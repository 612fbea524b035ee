#include "tools/phantom/scene.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"

namespace teres::phantom {
namespace {

constexpr double kBoard = 0.012;  // thickness of the frame's boards [m]

std::size_t at(std::int32_t index) {
    return static_cast<std::size_t>(index);
}

}  // namespace

Result<Scene> Scene::make(const Case& c, const SceneOptions& options) {
    Scene scene;
    scene.options_ = options;
    const auto camera = camera_pose(c.sensor);
    if (!camera)
        return invalid_input((c.folder / "case.json").string() +
                             ": sensor has no camera_position_m, view_direction and up: nothing to look from");
    scene.camera_ = *camera;

    const Surface surface(c.mesh);
    scene.surface_nodes_ = surface.nodes();
    scene.mesh_.rest = c.mesh.nodes;
    scene.mesh_.triangles = surface.triangles();
    scene.mesh_.material.assign(scene.mesh_.triangles.size(), Material::kLiver);
    scene.low_ = scene.high_ = c.mesh.nodes.front();
    for (const Point& x : c.mesh.nodes)
        for (std::size_t a = 0; a < 3; ++a) {
            scene.low_[a] = std::min(scene.low_[a], x[a]);
            scene.high_[a] = std::max(scene.high_[a], x[a]);
        }
    for (const MarkerRest& marker : c.markers) {
        const SurfacePoint p = surface.closest(marker.position_m);
        scene.markers_.push_back({marker.id, p.triangle, p.barycentric, p.position_m});
    }

    TERES_TRY(scene.read_motion(c));

    // A frame of boards around the liver, a back board and the table it stands on.
    const auto [lx, ly, lz] = scene.low_;
    const auto [hx, hy, hz] = scene.high_;
    const double gap = 0.030;
    scene.add_box({lx - gap - kBoard, ly - gap - kBoard, lz - 0.02}, {lx - gap, hy + gap + kBoard, lz + 0.03},
                  Material::kWood);
    scene.add_box({hx + gap, ly - gap - kBoard, lz - 0.02}, {hx + gap + kBoard, hy + gap + kBoard, lz + 0.03},
                  Material::kWood);
    scene.add_box({lx - gap, hy + gap, lz - 0.02}, {hx + gap, hy + gap + kBoard, lz + 0.03}, Material::kWood);
    scene.add_box({lx - gap, ly - gap - kBoard, lz - 0.02}, {hx + gap, ly - gap, lz + 0.03}, Material::kWood);
    scene.add_band(c, surface);
    scene.table_begin_ = scene.mesh_.rest.size();
    scene.add_box({lx - 0.15, ly - 0.15, lz - 0.05}, {hx + 0.15, hy + 0.15, lz - 0.04}, Material::kTable);
    if (options.occlusion > 0.0) scene.add_retractor();
    scene.mesh_.now = scene.mesh_.rest;
    scene.move_to(0.0);
    return scene;
}

Status Scene::read_motion(const Case& c) {
    const auto file = c.folder / "validation.csv";
    TERES_TRY_ASSIGN(const auto rows, read_positions(file, "point_id"));
    const auto points = static_cast<Eigen::Index>(c.validation_rest.size());
    if (points < 5)
        return invalid_input((c.folder / "validation_rest.csv").string() + ": fewer than 5 points carry no motion");
    std::map<std::int32_t, Eigen::Index> row_of;
    for (Eigen::Index k = 0; k < points; ++k) row_of[c.validation_rest[static_cast<std::size_t>(k)].id] = k;
    const auto terms = [&](const Point& X) {
        Eigen::VectorXd row(points + 4);
        for (Eigen::Index k = 0; k < points; ++k)
            row[k] = std::pow(distance(X, c.validation_rest[static_cast<std::size_t>(k)].position_m), 3);
        row.tail<4>() << 1.0, X[0], X[1], X[2];
        return row;
    };
    Eigen::MatrixXd K = Eigen::MatrixXd::Zero(points + 4, points + 4);
    for (Eigen::Index k = 0; k < points; ++k) {
        K.row(k) = terms(c.validation_rest[static_cast<std::size_t>(k)].position_m).transpose();
        K.col(k).tail<4>() = K.row(k).tail<4>().transpose();
    }
    const auto solver = K.fullPivLu();
    if (!solver.isInvertible())
        return invalid_input((c.folder / "validation_rest.csv").string() +
                             ": points lie in one plane or twice in one place");
    Eigen::MatrixXd at_nodes(std::ssize(surface_nodes_), points + 4);
    for (std::size_t i = 0; i < surface_nodes_.size(); ++i)
        at_nodes.row(static_cast<Eigen::Index>(i)) = terms(c.mesh.nodes[at(surface_nodes_[i])]).transpose();

    for (std::size_t first = 0, end = 0; first < rows.size(); first = end) {
        auto& true_points = points_.emplace_back(c.validation_rest.size());
        Eigen::MatrixXd u = Eigen::MatrixXd::Constant(points + 4, 3, std::numeric_limits<double>::quiet_NaN());
        u.bottomRows<4>().setZero();
        for (end = first; end < rows.size() && rows[end].t_s == rows[first].t_s; ++end) {
            const auto found = row_of.find(rows[end].id);
            if (found == row_of.end()) continue;
            const Point d =
                minus(rows[end].position_m, c.validation_rest[static_cast<std::size_t>(found->second)].position_m);
            u.row(found->second) << d[0], d[1], d[2];
            true_points[static_cast<std::size_t>(found->second)] = rows[end].position_m;
        }
        if (!u.allFinite())
            return invalid_input(file.string() + ": a point is missing at t = " + std::to_string(rows[first].t_s) +
                                 " s");
        const Eigen::MatrixXd moved = at_nodes * solver.solve(u);
        times_.push_back(rows[first].t_s);
        auto& frame = trajectories_.emplace_back();
        for (std::size_t i = 0; i < surface_nodes_.size(); ++i) {
            const auto d = moved.row(static_cast<Eigen::Index>(i));
            frame.push_back(plus(c.mesh.nodes[at(surface_nodes_[i])], {d[0], d[1], d[2]}));
        }
    }
    if (times_.size() < 2) return invalid_input(file.string() + ": fewer than two times");
    return {};
}

// Quads over the edges of the surface whose both nodes the atlas takes for attached, out to the height of the ligament.
void Scene::add_band(const Case& c, const Surface& surface) {
    if (!c.ligament) return;
    std::vector<double> probability(c.mesh.nodes.size(), 0.0);
    for (const NodeProbability& p : c.ligament_prior) probability[at(p.node_id)] = p.probability;
    const std::vector<Point> normals = surface.node_normals();
    std::map<std::int32_t, std::int32_t> far;
    for (std::size_t i = 0; i < surface_nodes_.size(); ++i) {
        const std::int32_t node = surface_nodes_[i];
        if (probability[at(node)] < 0.6) continue;
        far[node] = static_cast<std::int32_t>(mesh_.rest.size());
        mesh_.rest.push_back(plus(c.mesh.nodes[at(node)], times(c.ligament->height_m, normals[i])));
    }
    for (const auto& triangle : surface.triangles())
        for (std::size_t e = 0; e < 3; ++e) {
            const std::int32_t a = triangle[e], b = triangle[(e + 1) % 3];
            if (a > b || !far.contains(a) || !far.contains(b)) continue;
            mesh_.triangles.push_back({a, b, far[b]});
            mesh_.triangles.push_back({a, far[b], far[a]});
            mesh_.material.insert(mesh_.material.end(), 2, Material::kCloth);
        }
}

void Scene::add_box(const Point& low, const Point& high, Material material) {
    const auto first = static_cast<std::int32_t>(mesh_.rest.size());
    for (int corner = 0; corner < 8; ++corner)
        mesh_.rest.push_back(
            {(corner & 1) ? high[0] : low[0], (corner & 2) ? high[1] : low[1], (corner & 4) ? high[2] : low[2]});
    constexpr std::array<std::array<std::int32_t, 3>, 12> faces{{{0, 2, 1},
                                                                 {1, 2, 3},
                                                                 {4, 5, 6},
                                                                 {5, 7, 6},
                                                                 {0, 1, 4},
                                                                 {1, 5, 4},
                                                                 {2, 6, 3},
                                                                 {3, 6, 7},
                                                                 {0, 4, 2},
                                                                 {2, 4, 6},
                                                                 {1, 3, 5},
                                                                 {3, 7, 5}}};
    for (const auto& [a, b, c] : faces) mesh_.triangles.push_back({first + a, first + b, first + c});
    mesh_.material.insert(mesh_.material.end(), faces.size(), material);
}

// A blade 25 mm above the liver, seen by the camera as `occlusion` of the liver's width.
void Scene::add_retractor() {
    retractor_begin_ = mesh_.rest.size();
    const double z = high_[2] + 0.025;
    const double eye = camera_.t[2];
    const double shrink = eye > z ? (eye - z) / (eye - 0.5 * (low_[2] + high_[2])) : 1.0;
    const double half = 0.5 * options_.occlusion * (high_[0] - low_[0]) * shrink;
    add_box({-half, low_[1] - 0.02, z}, {half, high_[1] + 0.15, z + 0.002}, Material::kSteel);
}

void Scene::move_retractor(double t_s) {
    if (options_.occlusion <= 0.0) return;
    const double phase = t_s / options_.sweep_period_s - std::floor(t_s / options_.sweep_period_s);
    const double sweep = phase < 0.5 ? 2.0 * phase : 2.0 - 2.0 * phase;
    const double x = low_[0] + sweep * (high_[0] - low_[0]);
    for (std::size_t i = retractor_begin_; i < mesh_.rest.size(); ++i)
        mesh_.now[i] = plus(mesh_.rest[i], {x, 0.0, 0.0});
}

double Scene::case_time(double t_s) const {
    const double length = times_.back() - times_.front();
    const double turn = std::fmod(t_s, 2.0 * length);
    return times_.front() + (turn <= length ? turn : 2.0 * length - turn);
}

void Scene::move_to(double t_s) {
    const double t = case_time(t_s);
    const auto after = std::upper_bound(times_.begin(), times_.end(), t);
    const auto k =
        static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(after - times_.begin(), 1, std::ssize(times_) - 1));
    const double w = std::clamp((t - times_[k - 1]) / (times_[k] - times_[k - 1]), 0.0, 1.0);
    const auto between = [&](const std::vector<std::vector<Point>>& paths, std::size_t i) {
        return plus(shift_now_, plus(times(1.0 - w, paths[k - 1][i]), times(w, paths[k][i])));
    };
    shift_now_ = options_.respiration ? options_.respiration->at(t_s) : Point{};
    for (std::size_t v = 0; v < table_begin_; ++v) mesh_.now[v] = plus(mesh_.rest[v], shift_now_);
    for (std::size_t i = 0; i < surface_nodes_.size(); ++i)
        mesh_.now[at(surface_nodes_[i])] = between(trajectories_, i);
    points_now_.resize(points_[k].size());
    for (std::size_t i = 0; i < points_now_.size(); ++i) points_now_[i] = between(points_, i);
    move_retractor(t_s);
}

Point Scene::marker_now(const Marker& marker) const {
    Point x{};
    for (std::size_t i = 0; i < 3; ++i)
        x = plus(x, times(marker.weights[i], mesh_.now[at(mesh_.triangles[at(marker.triangle)][i])]));
    return x;
}

}  // namespace teres::phantom
