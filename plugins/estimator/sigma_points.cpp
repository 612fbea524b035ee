#include "plugins/estimator/sigma_points.h"

#include <cmath>

#include "core/check.h"

namespace teres {
namespace {

SigmaPoints make_simplex(Eigen::Index p) {
    const Eigen::Index r = p + 1;
    const double b = static_cast<double>(p) / static_cast<double>(r);
    Eigen::MatrixXd W = Eigen::MatrixXd::Zero(p, r);
    const double s0 = 1.0 / std::sqrt(2.0 * b);
    W(0, 0) = -s0;
    W(0, 1) = s0;
    for (Eigen::Index i = 1; i < p; ++i) {
        const double k = static_cast<double>(i + 1);
        const double s = 1.0 / std::sqrt(b * k * (k + 1.0));
        W.row(i).head(i + 1).setConstant(s);
        W(i, i + 1) = -k * s;
    }
    // |I_i|^2 = p: all points at the same distance from the mean.
    return {std::sqrt(static_cast<double>(p)) * W, Eigen::VectorXd::Constant(r, 1.0 / static_cast<double>(r)), 1.0};
}

SigmaPoints make_star(Eigen::Index p, double lambda, bool constant_weight) {
    const double scale = static_cast<double>(p) + lambda;
    SigmaPoints points;
    points.unit = Eigen::MatrixXd::Zero(p, 2 * p + 1);
    points.unit.middleCols(1, p).diagonal().setConstant(std::sqrt(scale));
    points.unit.rightCols(p).diagonal().setConstant(-std::sqrt(scale));
    points.weights = Eigen::VectorXd::Constant(2 * p + 1, 0.5 / scale);
    if (!constant_weight) points.weights(0) = lambda / scale;
    return points;
}

}  // namespace

SigmaPoints make_sigma_points(SigmaPointKind kind, Eigen::Index p, double lambda) {
    TERES_CHECK(p >= 1);
    TERES_CHECK(lambda >= 0.0);
    if (kind == SigmaPointKind::kSimplex) return make_simplex(p);
    if (kind == SigmaPointKind::kSimplexMixedWeights) {
        SigmaPoints points = make_simplex(p);
        points.unit *= static_cast<double>(p) / static_cast<double>(p + 1);
        points.observation_factor = static_cast<double>(p + 1) / static_cast<double>(p);
        return points;
    }
    return make_star(p, lambda, kind == SigmaPointKind::kStarConstantWeight);
}

}  // namespace teres
