#include "plugins/estimator/ensemble_correction.h"

#include <cmath>

#include "core/check.h"

namespace teres {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Correction ensemble_correction(const Innovation& innovation, const VectorXd& noise_variance,
                               std::span<const std::uint8_t> used) {
    const Index m = innovation.residual.size();
    const Index q = innovation.deviations.cols();
    TERES_CHECK(innovation.deviations.rows() == m);
    TERES_CHECK(noise_variance.size() == m);
    TERES_CHECK(used.empty() || static_cast<Index>(used.size()) == m);

    Correction correction;
    for (Index i = 0; i < m; ++i) correction.num_used += used.empty() || used[static_cast<std::size_t>(i)] != 0;

    // [R^-1/2 Y; 1] with its columns in reverse order: the reversed R factor then inverts to a lower
    // triangle.
    const Index k = correction.num_used;
    MatrixXd stack(k + q, q);
    VectorXd rhs = VectorXd::Zero(k + q);
    Index row = 0;
    for (Index i = 0; i < m; ++i) {
        if (!used.empty() && used[static_cast<std::size_t>(i)] == 0) continue;
        const double weight = 1.0 / std::sqrt(noise_variance(i));
        stack.row(row) = weight * innovation.deviations.row(i).reverse();
        rhs(row) = weight * innovation.residual(i);
        ++row;
    }
    stack.bottomRows(q) = MatrixXd::Identity(q, q).rowwise().reverse();

    const VectorXd observed = rhs;
    Eigen::HouseholderQR<MatrixXd> qr(stack);
    rhs.applyOnTheLeft(qr.householderQ().adjoint());
    const auto R = qr.matrixQR().topRows(q).triangularView<Eigen::Upper>();
    correction.weights = R.solve(rhs.head(q)).reverse();
    MatrixXd inverse = R.solve(MatrixXd::Identity(q, q));
    for (Index j = 0; j < q; ++j)
        if (inverse(j, j) < 0.0) inverse.col(j) = -inverse.col(j);
    correction.root = inverse.reverse();
    correction.root.triangularView<Eigen::StrictlyUpper>().setZero();
    correction.nis = (observed - stack * correction.weights.reverse()).squaredNorm();
    return correction;
}

MatrixXd lower_root_of_gram(const MatrixXd& M) {
    const Index p = M.cols();
    MatrixXd padded = MatrixXd::Zero(std::max(M.rows(), p), p);
    padded.topRows(M.rows()) = M;
    Eigen::HouseholderQR<MatrixXd> qr(padded);
    MatrixXd T = MatrixXd::Zero(p, p);
    T.triangularView<Eigen::Lower>() = qr.matrixQR().topRows(p).transpose().triangularView<Eigen::Lower>();
    for (Index j = 0; j < p; ++j)
        if (T(j, j) < 0.0) T.col(j) = -T.col(j);
    return T;
}

MatrixXd lower_root(const MatrixXd& P) {
    TERES_CHECK(P.rows() == P.cols());
    const Eigen::LLT<MatrixXd> llt(P);
    if (llt.info() == Eigen::Success) return llt.matrixL();
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(P);
    const VectorXd root = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    return lower_root_of_gram(root.asDiagonal() * eigen.eigenvectors().transpose());
}

}  // namespace teres
