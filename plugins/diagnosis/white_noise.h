// How much of a whitened residual is white in time and between markers: what an underestimated sensor noise leaves, and
// no mechanical effect does.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "plugins/diagnosis/whitener.h"

namespace teres {

/// Times the stated noise: up to that no finding, nobody knows noise better.
inline constexpr double kMisstatedNoise = 1.1;

/// Standard deviation of the white part of `residual`. rows: trajectory row of each entry.
double white_noise_factor(const Eigen::VectorXd& residual, const std::vector<Eigen::Index>& rows,
                          std::size_t num_markers);

/// That over what the stated noise leaves, whose whitened cost is `noise`: by how much the markers scatter more than
/// stated. 1 up to kMisstatedNoise, and where none is stated.
double stated_noise_factor(const Eigen::VectorXd& residual, const Whitener& whitener, double noise,
                           std::size_t num_markers);

}  // namespace teres
