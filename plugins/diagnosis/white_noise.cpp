#include "plugins/diagnosis/white_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

constexpr Eigen::Index kSpatialModes = 3;  // taken off first: what moves many markers at once is not noise

}  // namespace

double white_noise_factor(const Eigen::VectorXd& residual, const std::vector<Eigen::Index>& rows,
                          std::size_t num_markers) {
    const auto channels = static_cast<Eigen::Index>(3 * num_markers);
    if (rows.empty()) return 1.0;
    const Eigen::Index frames = rows.back() / channels + 1;
    Eigen::MatrixXd R = Eigen::MatrixXd::Zero(channels, frames);  // lost entries: zero, counted below
    Eigen::MatrixXi seen = Eigen::MatrixXi::Zero(channels, frames);
    for (std::size_t k = 0; k < rows.size(); ++k) {
        R(rows[k] % channels, rows[k] / channels) = residual(static_cast<Eigen::Index>(k));
        seen(rows[k] % channels, rows[k] / channels) = 1;
    }
    if (frames < 4 || channels <= 2 * kSpatialModes) return 1.0;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(R, Eigen::ComputeThinU);
    const Eigen::MatrixXd U = svd.matrixU().leftCols(kSpatialModes);
    R -= U * (U.transpose() * R);
    // Var of second differences of white noise is 6 sigma^2; the median over channels ignores single bad markers.
    std::vector<double> variance;
    for (Eigen::Index c = 0; c < channels; ++c) {
        double sum = 0.0;
        int count = 0;
        for (Eigen::Index f = 1; f + 1 < frames; ++f)
            if (seen(c, f - 1) && seen(c, f) && seen(c, f + 1)) {
                const double d = R(c, f - 1) - 2.0 * R(c, f) + R(c, f + 1);
                sum += d * d / 6.0;
                ++count;
            }
        if (count > 2) variance.push_back(sum / count);
    }
    if (variance.empty()) return 1.0;
    std::nth_element(variance.begin(), variance.begin() + static_cast<std::ptrdiff_t>(variance.size() / 2),
                     variance.end());
    const double kept = 1.0 - static_cast<double>(kSpatialModes) / static_cast<double>(channels);
    return std::sqrt(variance[variance.size() / 2] / kept);
}

}  // namespace teres
