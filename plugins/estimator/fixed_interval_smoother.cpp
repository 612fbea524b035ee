#include "plugins/estimator/fixed_interval_smoother.h"

namespace teres {

std::vector<SmoothedFrame> smooth(const std::vector<FilteredFrame>& frames) {
    std::vector<SmoothedFrame> smoothed(frames.size());
    if (frames.empty()) return smoothed;
    smoothed.back() = {frames.back().mean, frames.back().covariance};
    for (std::size_t k = frames.size() - 1; k-- > 0;) {
        const FilteredFrame& now = frames[k];
        const Eigen::MatrixXd& predicted = frames[k + 1].predicted_covariance;
        // G^T = (P-)^-1 P, both symmetric.
        const Eigen::MatrixXd G = predicted.ldlt().solve(now.covariance).transpose();
        smoothed[k].mean = now.mean + G * (smoothed[k + 1].mean - now.mean);
        const Eigen::MatrixXd P = now.covariance + G * (smoothed[k + 1].covariance - predicted) * G.transpose();
        smoothed[k].covariance = 0.5 * (P + P.transpose());
    }
    return smoothed;
}

}  // namespace teres
