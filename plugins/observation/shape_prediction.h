// Where a point of the organ should be, from where its neighbours are: a locally affine displacement field.
//
//     min over a, B  Σ_j w_j |u_j - a - B (X_j - X)|² + λ |B|²,    w_j = exp(-|X_j - X|² / 2 L²),    x(X) = X + a
//
// X rest, u displacement. λ keeps few or coplanar neighbours from tilting the field without bound.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

namespace teres {

struct Neighbour {
    std::size_t marker = 0;
    Eigen::Vector3d X, x;  ///< rest, now [m]
};

/// [loop] Leaves out the neighbour `marker` itself. Nothing without neighbours.
std::optional<Eigen::Vector3d> predict_from_neighbours(const std::vector<Neighbour>& neighbours, std::size_t marker,
                                                       const Eigen::Vector3d& X, double reach_m);

}  // namespace teres
