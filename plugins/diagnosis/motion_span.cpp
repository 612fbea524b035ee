#include "plugins/diagnosis/motion_span.h"

#include "plugins/diagnosis/temporal_modes.h"

namespace teres {
namespace {

constexpr double kLeastMode = 1e-3;  // of the first

Eigen::MatrixXd temporal_basis(const Eigen::VectorXd& motion, Eigen::Index channels) {
    Eigen::MatrixXd moved = Eigen::Map<const Eigen::MatrixXd>(motion.data(), channels, motion.size() / channels);
    moved.colwise() -= moved.rowwise().mean().eval();
    return temporal_modes(moved, kLeastMode);
}

}  // namespace

MotionSpan::MotionSpan(const Eigen::VectorXd& motion, std::size_t channels, const std::vector<Eigen::Index>& rows)
    : channels_(channels) {
    const auto count = static_cast<Eigen::Index>(channels);
    const Eigen::MatrixXd basis = temporal_basis(motion, count);
    std::vector<std::vector<Eigen::Index>> frames(channels);
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const auto c = static_cast<std::size_t>(rows[k] % count);
        channels_[c].at.push_back(static_cast<Eigen::Index>(k));
        frames[c].push_back(rows[k] / count);
    }
    for (std::size_t c = 0; c < channels; ++c) {
        if (frames[c].empty()) continue;
        const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(basis(frames[c], Eigen::all));
        const auto seen = static_cast<Eigen::Index>(frames[c].size());
        channels_[c].basis = qr.householderQ() * Eigen::MatrixXd::Identity(seen, qr.rank());
        degrees_ += static_cast<double>(seen - qr.rank());
    }
}

double MotionSpan::beside(const Eigen::VectorXd& residual) const {
    double sum = 0.0;
    for (const Channel& channel : channels_) {
        if (channel.at.empty()) continue;
        const Eigen::VectorXd own = residual(channel.at);
        sum += own.squaredNorm() - (channel.basis.transpose() * own).squaredNorm();
    }
    return sum;
}

}  // namespace teres
