// Turns the metric with the body: where the surroundings of node i have turned by R_i since K was made at x0,
//
//   K(x) ~ R K(x0) R^T,     K(x)^-1 r ~ R K(x0)^-1 R^T r,     R = diag(R_i)
//
// (warped stiffness: Mueller et al., SCA 2002; as a preconditioner: Courtecuisse et al., Prog. Biophys. Mol. Biol.
// 103, 2010). R_i is the rotation of A_i = sum_j (x_j - x_i) (x0_j - x0_i)^T over the neighbours j in the mesh. It
// only serves as the metric of the quasi-Newton: what it leaves out costs iterations, never accuracy.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "plugins/simulation/block_pattern.h"
#include "plugins/simulation/metric_solver.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

class MetricRotation {
  public:
    /// [setup]
    MetricRotation(const BlockPattern& pattern, std::size_t num_nodes, const MetricSolver& metric);

    /// [loop] Where K is made.
    void read(const Positions& x0) noexcept;
    /// [loop] Finds the rotations at the first lane of x (batch layout).
    void follow(const double* x, std::size_t stride) noexcept;
    /// [loop] y <- R^T y and y <- R y, rows of the metric with `stride` values each.
    void turn_back(float* y, std::size_t stride) const noexcept;
    void turn(float* y, std::size_t stride) const noexcept;

  private:
    struct Node {
        NodeIndex node = 0;
        std::int32_t row[3] = {};    // of the metric
        std::size_t neighbours = 0;  // first of neighbour_
    };
    std::vector<Node> nodes_;  // free ones; one more for the end of neighbour_
    std::vector<NodeIndex> neighbour_;
    Positions x0_;
    std::vector<Eigen::Quaterniond> turn_;
    std::vector<Eigen::Matrix3f> R_;
};

}  // namespace teres
