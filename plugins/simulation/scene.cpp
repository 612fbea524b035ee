#include "plugins/simulation/scene.h"

#include <Eigen/Geometry>

#include "core/case/frame_times.h"

namespace teres {

using Eigen::Vector3d;

Scene::Scene(const Case& c, CaseModel& model, const TetherRanges& ranges, double layer)
    : data(c),
      mesh(model.mesh()),
      surface(c.mesh),
      tethers(ranges),
      clamp_layer_m(layer),
      dynamic(model.scheme() != TimeScheme::kQuasiStatic),
      parts(model.system().parts()) {
    const std::vector<double> times = frame_times(c);
    if (!times.empty()) {
        start_s = times.front();
        end_s = times.back();
    }
    const Material& material = parts.body.material();
    youngs_modulus_pa = 3.0 * material.mu();  // nearly incompressible: E = 2 (1 + nu) mu
    const Vector3d low = mesh.X.rowwise().minCoeff(), high = mesh.X.rowwise().maxCoeff();
    centre = 0.5 * (low + high);
    size_m = (high - low).norm();
    mass_kg = parts.node_mass_kg.sum();
    for (const auto& set : parts.body.points()) {
        auto& at = point_centre.emplace_back(3, static_cast<Eigen::Index>(set.size()));
        for (std::size_t q = 0; q < set.size(); ++q) {
            // sum_i N_i X_i of a point is not kept; its patch's mean is near enough for smooth fields
            Vector3d mean = Vector3d::Zero();
            for (auto i = set.offset[q]; i < set.offset[q + 1]; ++i)
                mean += parts.X.col(set.node[static_cast<std::size_t>(i)]);
            at.col(static_cast<Eigen::Index>(q)) = mean / (set.offset[q + 1] - set.offset[q]);
        }
        nominal_.scale.push_back(set.stiffness_scale);
    }
    nominal_.tethers = parts.tethers;
    nominal_.node_mass_kg = parts.node_mass_kg;
    nominal_.gravity_m_s2 = parts.gravity_m_s2;
    parts.term = &obstacles;
    reset(start_s, std::vector<double>(3 * parts.loads.size(), 0.0));
}

void Scene::reset(double t, const std::vector<double>& region_force) {
    t_s = t;
    region_force_n = region_force;
    if (body_touched) {
        auto& points = parts.body.points();
        for (std::size_t s = 0; s < points.size(); ++s) {
            points[s].stiffness_scale = nominal_.scale[s];
            points[s].stiffening = 0.0;
            points[s].prestress.clear();
        }
    }
    if (ties_touched) parts.tethers = nominal_.tethers;
    body_touched = ties_touched = false;
    parts.node_mass_kg = nominal_.node_mass_kg;
    parts.gravity_m_s2 = nominal_.gravity_m_s2;
    force_n.setZero(3, parts.X.cols());
    pressure_pa.setZero(static_cast<Eigen::Index>(mesh.surface.size()));
    obstacles.clear();
    viscosity.clear();
    if (data.body.rayleigh_stiffness_s > 0.0) viscosity.push_back({data.body.rayleigh_stiffness_s, 0.0});
    rayleigh_mass_1_s = data.body.rayleigh_mass_1_s;
}

// f_i = -sum over its triangles of p A n / 3 with the deformed area vector A n
void Scene::add_pressure_force(const double* x, double* f) const {
    for (std::size_t t = 0; t < mesh.surface.size(); ++t) {
        const double p = pressure_pa(static_cast<Eigen::Index>(t));
        if (p == 0.0) continue;
        const auto at = [&](std::size_t i) { return Eigen::Map<const Vector3d>(x + 3 * mesh.surface[t][i]); };
        const Vector3d share = -p / 6.0 * (at(1) - at(0)).cross(at(2) - at(0));
        for (const auto node : mesh.surface[t]) Eigen::Map<Vector3d>(f + 3 * node) += share;
    }
}

}  // namespace teres
