// Smooth bodies that the surface may touch but not enter: penalty, no friction.
//
//     d_i = |x_i - c| - R          distance of node i from a sphere (large R: a plane)     [m]
//     Psi = sum_i k a_i/2 min(d_i, 0)^2      k [N/m^3] per area, a_i area of node i [m^2]
#pragma once

#include "plugins/simulation/potential_term.h"

namespace teres {

struct Obstacle {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    double radius_m = 0.0;
    double stiffness_n_per_m3 = 0.0;
    std::vector<NodeIndex> node;  ///< that may touch it
    std::vector<double> area_m2;
};

class Obstacles final : public PotentialTerm {
  public:
    void clear() { obstacles_.clear(); }
    void add(Obstacle obstacle) { obstacles_.push_back(std::move(obstacle)); }
    void add_gradient(const double* x, double* gradient, double* energy, std::size_t stride,
                      std::size_t lanes) const noexcept override;
    void add_tangent(const Positions& x, const BlockPattern& pattern,
                     std::vector<double>& values) const noexcept override;

  private:
    std::vector<Obstacle> obstacles_;
};

}  // namespace teres
