// Our own filter, as the product runs it, on the observations of a folder.
#pragma once

#include <string>
#include <vector>

#include "core/result.h"
#include "plugins/estimator/boundary_estimator.h"
#include "tools/peer_bench/own_model.h"
#include "tools/peer_bench/peer_run.h"

namespace teres::peer {

struct OwnRun {
    std::vector<int> step;           ///< generator step of each row
    Eigen::MatrixXd mean, stdev;     ///< rows x parameters, physical
    Eigen::MatrixXd theta, sigma;    ///< the same in filter coordinates (logarithms)
    std::vector<std::string> names;  ///< the folder's, then velocity_damping
    std::vector<std::size_t> refused;
    double closing_nis = 0.0;  ///< median NIS per degree of freedom over the last half: about 1 if consistent
    EstimatorCounters counters;
    double seconds = 0.0;
};

/// model_error_sigma_m: 0 takes the recording's rounding for the only noise.
BoundaryEstimatorOptions own_options(double model_error_sigma_m);

/// `generator`: its tool and load alignment are the recording's time stamps. z: rows of the recording.
Result<OwnRun> run_own_filter(const Scene& scene, const PeerModel& model, const std::vector<Eigen::VectorXd>& z,
                              int last_step, double model_error_sigma_m, std::size_t threads, const Progress& progress);

/// Standard deviation [m] of the rounding of a point's recorded coordinates, the largest of its axes.
double rounding_sigma(const Scene& scene, std::size_t point, const Eigen::VectorXd& z);

}  // namespace teres::peer
