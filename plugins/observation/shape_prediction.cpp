#include "plugins/observation/shape_prediction.h"

#include <Eigen/Dense>
#include <cmath>

namespace teres {

std::optional<Eigen::Vector3d> predict_from_neighbours(const std::vector<Neighbour>& neighbours, std::size_t marker,
                                                       const Eigen::Vector3d& X, double reach_m) {
    constexpr double kRidge = 0.02;  // λ / L², in units of the weights
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> b = Eigen::Matrix<double, 4, 3>::Zero();
    for (const Neighbour& n : neighbours) {
        if (n.marker == marker) continue;
        const Eigen::Vector3d d = (n.X - X) / reach_m;
        const double w = std::exp(-0.5 * d.squaredNorm()) + 1e-6;
        const Eigen::Vector4d row(1.0, d.x(), d.y(), d.z());
        A += w * row * row.transpose();
        b += w * row * (n.x - n.X).transpose();
    }
    if (!(A(0, 0) > 0.0)) return std::nullopt;
    A.diagonal().tail<3>().array() += kRidge * A(0, 0);
    const Eigen::Matrix<double, 4, 3> solution = A.ldlt().solve(b);
    return X + solution.row(0).transpose();
}

}  // namespace teres
