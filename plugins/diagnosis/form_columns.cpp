#include "plugins/diagnosis/form_columns.h"

#include <algorithm>
#include <numbers>

namespace teres {
namespace {

constexpr Eigen::Index kModes = 3;  // of the effect's own motion
constexpr int kWaves = 2;           // slow changes of its size

// Central differences over the frames.
Eigen::MatrixXd rate(const Eigen::MatrixXd& a) {
    Eigen::MatrixXd out(a.rows(), a.cols());
    for (Eigen::Index f = 0; f < a.cols(); ++f) {
        const Eigen::Index next = std::min(f + 1, a.cols() - 1), last = std::max<Eigen::Index>(f - 1, 0);
        out.col(f) = (a.col(next) - a.col(last)) / static_cast<double>(std::max<Eigen::Index>(1, next - last));
    }
    return out;
}

void append(Eigen::MatrixXd& columns, const Eigen::MatrixXd& field, double size) {
    const double norm = field.norm();
    if (!(norm > 1e-9 * size)) return;
    columns.conservativeResize(field.size(), columns.cols() + 1);
    columns.rightCols<1>() = size / norm * field.reshaped();
}

}  // namespace

Eigen::MatrixXd form_columns(Simulator& simulator, const Assumption& at, const Eigen::VectorXd& with, double share) {
    const auto channels = static_cast<Eigen::Index>(3 * simulator.num_markers());
    const auto frames = static_cast<Eigen::Index>(simulator.num_frames());
    Eigen::MatrixXd columns(with.size(), 0);
    for (std::size_t e = 0; e < at.effects.size(); ++e) {
        if (simulator.effects()[at.effects[e].entry].exact_form()) continue;
        Assumption without = at;
        without.effects.erase(without.effects.begin() + static_cast<std::ptrdiff_t>(e));
        Eigen::VectorXd trajectory;
        if (!simulator.simulate(without, trajectory)) continue;
        const Eigen::MatrixXd a = (with - trajectory).reshaped(channels, frames);
        const double size = share * a.norm();
        if (!(size > 0.0)) continue;
        const Eigen::BDCSVD<Eigen::MatrixXd> svd(a, Eigen::ComputeThinU | Eigen::ComputeThinV);
        const Eigen::VectorXd course = svd.matrixV().col(0) / svd.matrixV().col(0).lpNorm<Eigen::Infinity>();
        const Eigen::VectorXd time = Eigen::VectorXd::LinSpaced(frames, 0.0, std::numbers::pi);
        append(columns, a * course.asDiagonal(), size);
        append(columns, a * course.cwiseAbs2().asDiagonal(), size);
        append(columns, rate(a), size);
        for (int k = 1; k <= kWaves; ++k) append(columns, a * (k * time).array().cos().matrix().asDiagonal(), size);
        for (Eigen::Index m = 0; m < std::min(kModes, svd.singularValues().size()); ++m)
            append(columns, svd.singularValues()(m) * svd.matrixU().col(m) * svd.matrixV().col(m).transpose(),
                   share * svd.singularValues()(m));
    }
    Eigen::VectorXd again;
    if (columns.cols() > 0) simulator.simulate(at, again);  // fits start from a whole trajectory nearby
    return columns;
}

}  // namespace teres
