#include "plugins/diagnosis/white_noise.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr Eigen::Index kSpatialModes = 3;                     // what moves many markers at once is not noise
constexpr double kStandsOut = 1.1;                            // of the largest singular value of white noise
constexpr double kOverlap = 1.0 + 2.0 * (16.0 + 1.0) / 36.0;  // 1 + 2 sum of squared correlations, -4/6 and 1/6
constexpr double kLeastShare = 0.2;                           // of white noise that is left without the leading modes
constexpr double kLeastWeight = 0.5;                          // of the median one

// A row per channel, a column per frame; lost entries are zero in R and not seen.
struct Residual {
    Eigen::MatrixXd R;
    Eigen::MatrixXi seen;
};

// Var of second differences of white noise is 6 sigma^2; the median over channels ignores single bad markers. That of
// chi^2 / k is (1 - 2/(9 k))^3 (Wilson and Hilferty), k: so many of the differences, which overlap, are independent.
// `kept`: share of the noise that is still there.
double standard_deviation(const Residual& residual, double kept) {
    const auto& [R, seen] = residual;
    std::vector<double> variance;
    int most = 0;
    for (Eigen::Index c = 0; c < R.rows(); ++c) {
        double sum = 0.0;
        int count = 0;
        for (Eigen::Index f = 1; f + 1 < R.cols(); ++f)
            if (seen(c, f - 1) && seen(c, f) && seen(c, f + 1)) {
                const double d = R(c, f - 1) - 2.0 * R(c, f) + R(c, f + 1);
                sum += d * d / 6.0;
                ++count;
            }
        if (count > 2) variance.push_back(sum / count);
        most = std::max(most, count);
    }
    if (variance.empty()) return 1.0;
    const auto middle = variance.begin() + static_cast<std::ptrdiff_t>(variance.size() / 2);
    std::nth_element(variance.begin(), middle, variance.end());
    const double of_median = std::pow(1.0 - 2.0 * kOverlap / (9.0 * most), 3);
    return std::sqrt(*middle / (kept * of_median));
}

}  // namespace

double white_noise_factor(const Eigen::VectorXd& residual, const std::vector<Eigen::Index>& rows,
                          std::size_t num_markers) {
    const auto channels = static_cast<Eigen::Index>(3 * num_markers);
    if (rows.empty()) return 1.0;
    const Eigen::Index frames = rows.back() / channels + 1;
    Residual left{Eigen::MatrixXd::Zero(channels, frames), Eigen::MatrixXi::Zero(channels, frames)};
    for (std::size_t k = 0; k < rows.size(); ++k) {
        left.R(rows[k] % channels, rows[k] / channels) = residual(static_cast<Eigen::Index>(k));
        left.seen(rows[k] % channels, rows[k] / channels) = 1;
    }
    if (frames < 4 || channels <= 2 * kSpatialModes) return 1.0;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(left.R, Eigen::ComputeThinU);
    const Eigen::MatrixXd all = left.R;
    const auto without = [&](Eigen::Index modes, double share_of_one) {
        const Eigen::MatrixXd U = svd.matrixU().leftCols(modes);
        left.R = all - U * (U.transpose() * all);
        return standard_deviation(left, std::max(kLeastShare, 1.0 - static_cast<double>(modes) * share_of_one));
    };
    // Leading modes of white noise have singular values up to sqrt(channels) + sqrt(frames), more than a channel's
    // share: only what stands out of that, were they all of it, is taken off.
    const auto count = static_cast<double>(channels), length = static_cast<double>(frames);
    const double largest = std::sqrt(count) + std::sqrt(length);
    const double edge = kStandsOut * largest * without(kSpatialModes, largest * largest / (count * length));
    Eigen::Index modes = 0;
    while (modes < std::min(kSpatialModes, svd.singularValues().size()) && svd.singularValues()(modes) > edge) ++modes;
    return without(modes, 1.0 / count);
}

double stated_noise_factor(const Eigen::VectorXd& residual, const Whitener& whitener, double noise,
                           std::size_t num_markers) {
    if (noise <= 0.0) return 1.0;
    // In metres, where noise is as large at every frame: whitened, that of the few that weigh most would look like few
    // modes. Frames near another equilibrium, which weigh little, jump.
    const Eigen::VectorXd& weight = whitener.inverse_sigma();
    std::vector<double> sorted(weight.begin(), weight.end());
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    std::vector<Eigen::Index> rows, used;
    for (Eigen::Index k = 0; k < weight.size(); ++k) {
        if (weight(k) < kLeastWeight * *middle) continue;
        used.push_back(k);
        rows.push_back(whitener.rows()[static_cast<std::size_t>(k)]);
    }
    const double stated_m = std::sqrt(noise / weight.squaredNorm());
    const double factor = white_noise_factor(residual(used).cwiseQuotient(weight(used)), rows, num_markers) / stated_m;
    return factor > kMisstatedNoise ? factor : 1.0;
}

}  // namespace teres
