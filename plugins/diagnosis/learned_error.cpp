#include "plugins/diagnosis/learned_error.h"

namespace teres {

Eigen::VectorXd learned_error(const Whitener& whitener, const Discrepancy& discrepancy,
                              const Eigen::VectorXd& residual_m) {
    const Eigen::MatrixXd D = whitener.inverse_sigma().asDiagonal() * discrepancy.columns(whitener.rows(), Eigen::all);
    const Eigen::VectorXd r = whitener.inverse_sigma().cwiseProduct(residual_m(whitener.rows()));
    const Eigen::MatrixXd H = D.transpose() * D + Eigen::MatrixXd::Identity(D.cols(), D.cols());
    return H.ldlt().solve(D.transpose() * r);
}

}  // namespace teres
