// How much of a whitened residual is white in time and between markers: what an underestimated sensor noise leaves, and
// no mechanical effect does.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

/// Standard deviation of the white part of `residual` (1: as stated). rows: trajectory row of each entry.
double white_noise_factor(const Eigen::VectorXd& residual, const std::vector<Eigen::Index>& rows,
                          std::size_t num_markers);

}  // namespace teres
