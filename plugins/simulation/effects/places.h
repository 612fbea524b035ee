// Where and when: search grids over the body and the recording, smooth patches and windows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/effect_description.h"
#include "plugins/simulation/scene.h"

namespace teres {

/// At most `count` of the points, spread evenly (farthest-point order, deterministic); indices.
std::vector<std::size_t> spread(const Eigen::Matrix3Xd& points, std::size_t count);

/// Places on the surface (nodes), spread evenly; those of the prior ligament left out if `free_only`.
std::vector<Eigen::Vector3d> surface_places(const Scene& scene, std::size_t count, bool free_only);
/// Places inside the body, spread evenly.
std::vector<Eigen::Vector3d> inner_places(const Scene& scene, std::size_t count);
/// Balls about the ligament's groups, each of so many times its radius, and one that the whole of it lies in.
struct Ball {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double radius_m = 0.0;
};
std::vector<Ball> ligament_places(const Scene& scene, const std::vector<double>& sizes);

/// 1 inside the ball, 0 outside, edge a few tenths of the radius wide.
double inside(const Eigen::Vector3d& x, const Eigen::Vector3d& centre, double radius_m);
/// The same with an edge no wider than that: 0.9 and 0.1 at 2.2 edge_m inside and outside.
double inside(const Eigen::Vector3d& x, const Eigen::Vector3d& centre, double radius_m, double edge_m);

/// The part of the surface in the ball, shared by its nodes: integral over the surface of N_i(x) inside(x). Smooth in
/// centre and radius, also where the ball is smaller than the mesh. Of a ball beside the surface: the point of the
/// surface next to its centre. Good until the next call.
const Patch& surface_patch(Scene& scene, const Eigen::Vector3d& centre, double radius_m);

/// Smooth step from 0 before t0 to 1 after t0 + rise.
double ramp(double t, double t0, double rise);

/// Instants at which something may begin, spread over the recording.
std::vector<double> onset_grid(const Scene& scene, int count);

/// The three shape parameters center_x, center_y, center_z of a place on or in the body.
void add_centre(std::vector<EffectParameter>& parameters, const Scene& scene);
/// Of a place on the surface.
void add_surface_centre(EffectDescription& description, const Scene& scene);

}  // namespace teres
