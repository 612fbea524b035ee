// A whitener that knows of nothing but white noise: every number of a trajectory, one standard deviation.
#pragma once

#include <numeric>
#include <vector>

#include "plugins/diagnosis/problem.h"

namespace teres::test {

inline Whitener white(const Simulator& simulator, double sigma_m) {
    std::vector<Eigen::Index> rows(simulator.num_rows());
    std::iota(rows.begin(), rows.end(), Eigen::Index{0});
    const auto size = static_cast<Eigen::Index>(rows.size());
    return tempered_whitener(rows, Eigen::VectorXd::Constant(size, sigma_m), Eigen::MatrixXd(size, 0), {});
}

}  // namespace teres::test
