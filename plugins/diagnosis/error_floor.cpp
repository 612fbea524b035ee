#include "plugins/diagnosis/error_floor.h"

namespace teres {

ErrorFloor error_floor(const Whitener& whitener, const Discrepancy& discrepancy, const Eigen::MatrixXd& J,
                       double noise_m, const Calibration& calibration) {
    ErrorFloor floor;
    floor.noise = noise_m * noise_m * whitener.inverse_sigma().squaredNorm();
    floor.model = calibration.model_error * static_cast<double>(whitener.size());
    if (discrepancy.columns.cols() == 0) return floor;
    const Eigen::MatrixXd D = whitener.inverse_sigma().asDiagonal() * discrepancy.columns(whitener.rows(), Eigen::all);
    const Eigen::MatrixXd H = Eigen::MatrixXd::Identity(J.cols(), J.cols()) + J.transpose() * J, JD = J.transpose() * D;
    floor.model += calibration.discrepancy_share * (D.squaredNorm() - JD.cwiseProduct(H.llt().solve(JD)).sum());
    return floor;
}

}  // namespace teres
