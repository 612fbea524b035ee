#include "plugins/simulation/marker_rows.h"

#include <Eigen/Geometry>
#include <array>

namespace teres {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

// dz/dx_i of a rider z = sum w_i x_i + o n, n = c/|c|, c = (x_1 - x_0) x (x_2 - x_0):  dn = (I - n n^T)/|c|
// dc
std::array<Matrix3d, 3> rider_derivative(const SurfaceRider& rider, const double* x) {
    const auto at = [&](std::size_t i) { return Eigen::Map<const Vector3d>(x + 3 * rider.node[i]); };
    const Vector3d a = at(1) - at(0), b = at(2) - at(0), c = a.cross(b);
    const double length = c.norm();
    const Vector3d n = c / length;
    const Matrix3d turn = rider.offset_m / length * (Matrix3d::Identity() - n * n.transpose());
    const auto skew = [](const Vector3d& v) {
        Matrix3d S;
        S << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
        return S;
    };
    std::array<Matrix3d, 3> D;
    D[1] = -turn * skew(b);  // dc = da x b = -b x da
    D[2] = turn * skew(a);   // dc = a x db
    D[0] = -D[1] - D[2];
    for (std::size_t i = 0; i < 3; ++i) D[i] += rider.weight[i] * Matrix3d::Identity();
    return D;
}

}  // namespace

MatrixXd marker_rows(const CaseModel& model, const double* x) {
    const auto& pattern = model.system().pattern();
    MatrixXd Ht = MatrixXd::Zero(pattern.num_rows(), static_cast<Eigen::Index>(3 * model.num_markers()));
    for (std::size_t m = 0; m < model.num_markers(); ++m) {
        const SurfaceRider& rider = model.markers()[m];
        const auto D = rider_derivative(rider, x);
        for (std::size_t i = 0; i < 3; ++i)
            if (const auto node = pattern.free_index(rider.node[i]); node >= 0)
                Ht.block<3, 3>(3 * node, static_cast<Eigen::Index>(3 * m)) += D[i].transpose();
    }
    return Ht;
}

MatrixXd point_rows(const CaseModel& model) {
    const auto& pattern = model.system().pattern();
    MatrixXd Ht = MatrixXd::Zero(pattern.num_rows(), static_cast<Eigen::Index>(3 * model.num_points()));
    for (std::size_t m = 0; m < model.num_points(); ++m)
        for (std::size_t i = 0; i < 4; ++i)
            if (const auto node = pattern.free_index(model.points()[m].node[i]); node >= 0)
                Ht.block<3, 3>(3 * node, static_cast<Eigen::Index>(3 * m)) +=
                    model.points()[m].weight[i] * Matrix3d::Identity();
    return Ht;
}

}  // namespace teres
