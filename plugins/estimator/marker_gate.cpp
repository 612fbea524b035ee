#include "plugins/estimator/marker_gate.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "plugins/estimator/probability.h"

namespace teres {

GateResult gate_markers(const Innovation& innovation, const Eigen::VectorXd& noise_variance,
                        std::span<const std::uint8_t> present, const GateOptions& options) {
    const std::size_t num_markers = present.size();
    TERES_CHECK(innovation.residual.size() == static_cast<Eigen::Index>(3 * num_markers));
    TERES_CHECK(noise_variance.size() == innovation.residual.size());

    GateResult result;
    result.use.assign(num_markers, MarkerUse::kMissing);
    result.sigma.assign(num_markers, 0.0);
    std::vector<double> distance(num_markers, 0.0), sorted;
    for (std::size_t j = 0; j < num_markers; ++j) {
        const auto row = static_cast<Eigen::Index>(3 * j);
        const auto Y = innovation.deviations.middleRows(row, 3);
        Eigen::Matrix3d S = Y * Y.transpose();
        S.diagonal() += noise_variance.segment(row, 3);
        result.sigma[j] = std::sqrt(S.trace() / 3.0);
        if (present[j] == 0) continue;
        const Eigen::Vector3d r = innovation.residual.segment(row, 3);
        distance[j] = r.dot(S.ldlt().solve(r));
        sorted.push_back(distance[j]);
        result.use[j] = MarkerUse::kUsed;
    }
    if (sorted.empty() || options.probability >= 1.0) return result;

    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double scale = std::max(1.0, *middle / chi_square_quantile(0.5, 3.0));
    const double bound = scale * chi_square_quantile(options.probability, 3.0);
    for (std::size_t j = 0; j < num_markers; ++j)
        if (result.use[j] == MarkerUse::kUsed && distance[j] > bound) {
            result.use[j] = MarkerUse::kGated;
            ++result.num_gated;
        }
    if (result.num_gated > options.max_share * static_cast<double>(sorted.size())) {
        for (MarkerUse& use : result.use)
            if (use == MarkerUse::kGated) use = MarkerUse::kUsed;
        result.num_gated = 0;
        result.overruled = true;
    }
    return result;
}

}  // namespace teres
