#include "plugins/diagnosis/temporal_modes.h"

#include <algorithm>
#include <cmath>

namespace teres {

Eigen::MatrixXd temporal_modes(const Eigen::MatrixXd& motion, double least_share) {
    constexpr Eigen::Index kMost = 8;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(motion, Eigen::ComputeThinV);
    const Eigen::VectorXd& s = svd.singularValues();
    Eigen::Index modes = 0;
    while (modes < std::min(kMost, s.size()) && s(modes) > least_share * s(0)) ++modes;
    Eigen::MatrixXd basis(motion.cols(), modes + 1);
    basis.col(0).setConstant(1.0 / std::sqrt(static_cast<double>(motion.cols())));
    basis.rightCols(modes) = svd.matrixV().leftCols(modes);
    return basis;
}

}  // namespace teres
