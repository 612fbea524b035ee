// A few frames of a recording that stand for all: which to take, and how to fill in the others. Columns are frames.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace teres {

/// Of the frames `among` (empty: all) some far apart in the space of shapes, each as far as possible from those before
/// it (Gonzalez' farthest points). nearest: for every frame the number of the nearest of them.
std::vector<std::size_t> distinct_frames(const std::vector<Eigen::VectorXd>& x, const std::vector<std::int32_t>& among,
                                         std::size_t most, std::vector<std::size_t>& nearest);

/// At most `most` frames, ascending, between which the columns of z are best interpolated in time: the ends, and again
/// and again the frame where that is worst. z has at least two columns.
std::vector<std::int32_t> frames_to_solve(const Eigen::MatrixXd& z, std::size_t most);

/// Columns at `frames` to all `count` columns, linearly between them.
Eigen::MatrixXd interpolate(const Eigen::MatrixXd& at_frames, const std::vector<std::int32_t>& frames,
                            Eigen::Index count);

/// First order dz at all frames, and the rest r at `frames`, to the whole change
///     (1 + a_f) dz_f + (r - a dz)_f,   a = <r, dz> / <dz, dz>,  numerator, denominator and the last term interpolated:
/// where first order falls short, it does so by a share that varies slowly.
Eigen::MatrixXd with_rest(const Eigen::MatrixXd& dz, Eigen::MatrixXd rest, const std::vector<std::int32_t>& frames);

}  // namespace teres
