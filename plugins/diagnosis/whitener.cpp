#include "plugins/diagnosis/whitener.h"

namespace teres {

Whitener::Whitener(std::vector<Eigen::Index> rows, const Eigen::VectorXd& sigma, const Eigen::MatrixXd& discrepancy)
    : rows_(std::move(rows)), inverse_sigma_(sigma.cwiseInverse()) {
    if (discrepancy.cols() == 0 || rows_.empty()) return;
    const Eigen::MatrixXd D = inverse_sigma_.asDiagonal() * discrepancy(rows_, Eigen::all);
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(D, Eigen::ComputeThinU);
    const Eigen::ArrayXd d2 = svd.singularValues().array().square();
    U_ = svd.matrixU();
    shrink_ = 1.0 - (1.0 + d2).rsqrt();
    explain_ = d2 / (1.0 + d2);
}

Eigen::MatrixXd Whitener::operator()(const Eigen::MatrixXd& trajectories) const {
    Eigen::MatrixXd scaled = inverse_sigma_.asDiagonal() * trajectories(rows_, Eigen::all);
    if (U_.cols() > 0) scaled -= U_ * (shrink_.asDiagonal() * (U_.transpose() * scaled));
    return scaled;
}

Eigen::VectorXd Whitener::without_discrepancy(const Eigen::VectorXd& trajectory) const {
    Eigen::VectorXd scaled = inverse_sigma_.asDiagonal() * trajectory(rows_);
    if (U_.cols() > 0) scaled -= U_ * (explain_.asDiagonal() * (U_.transpose() * scaled));
    return scaled.cwiseQuotient(inverse_sigma_);
}

}  // namespace teres
