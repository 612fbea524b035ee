// Which markers of a frame to believe. A marker's residual r (3-vector) is held against its predicted
// covariance:
//
//     S = Y_j Y_j^T + R_j        d^2 = r^T S^-1 r        outlier if d^2 > chi2_3(probability) * scale
//
// scale = max(1, median(d^2) / median of chi2_3): when all markers are off, it is the model that is wrong,
// and no marker is to blame. For the same reason nothing is gated when more than max_share of the markers
// would be.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "plugins/estimator/ensemble_correction.h"

namespace teres {

struct GateOptions {
    double probability = 0.9999;  ///< share of good markers that pass, in (0, 1); 1 turns the gate off
    double max_share = 0.5;       ///< more outliers than this share: none is gated
};

enum class MarkerUse : std::int8_t { kGated = -1, kMissing = 0, kUsed = 1 };

struct GateResult {
    std::vector<MarkerUse> use;  ///< per marker
    std::vector<double> sigma;   ///< predicted standard deviation of the residual per axis: sqrt(trace S / 3)
    int num_gated = 0;
    bool overruled = false;  ///< too many outliers: all were kept
};

/// present: one flag per marker; residual and noise_variance hold 3 rows per marker.
GateResult gate_markers(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                        std::span<const std::uint8_t> present, const GateOptions& options);

}  // namespace teres
