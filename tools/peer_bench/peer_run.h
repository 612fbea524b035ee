// The recorded filter run made again: the peer's filter, element, integrator, rounding and alignment.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "core/result.h"
#include "tools/peer_bench/peer_model.h"

namespace teres::peer {

struct FilterRun {
    Eigen::MatrixXd mean;   ///< rows x parameters, filter coordinates as the peer records them
    Eigen::MatrixXd stdev;  ///< the same
    double seconds = 0.0;
};

using Progress = std::function<void(int done, int total)>;

/// The parameter map of the folder's filter settings. Errors: bounds or priors that make no sense.
Result<ParameterMap> peer_parameters(const Scene& scene);

/// Rows 1..compared_rows. z: rows of the recording (observations()).
Result<FilterRun> run_peer_filter(const Scene& scene, const PeerModel& model, const std::vector<Eigen::VectorXd>& z,
                                  std::size_t threads, const Progress& progress);

/// Largest relative difference to expected_state.csv over the compared rows and where it is. Relative to the
/// expected value, but to no less than 1e-6 of the largest one in its column (a mean may pass through zero).
struct Comparison {
    double max_relative_difference = 0.0;
    int row = 0;
    Eigen::Index parameter = 0;
};
Comparison compare(const Scene& scene, const FilterRun& run);

}  // namespace teres::peer
