// Central differences, the independent truth for every derivative.
#pragma once

#include <Eigen/Dense>

namespace teres::test {

/// J(i,j) = d f_i / d x_j by central differences with step h.
template <class F, class Vector>
Eigen::MatrixXd jacobian(const F& f, const Vector& x, double h = 1e-6) {
    Eigen::VectorXd plus = x, minus = x;
    const Eigen::VectorXd f0 = f(x);
    Eigen::MatrixXd J(f0.size(), x.size());
    for (Eigen::Index j = 0; j < x.size(); ++j) {
        plus = x;
        minus = x;
        plus(j) += h;
        minus(j) -= h;
        J.col(j) = (Eigen::VectorXd(f(plus)) - Eigen::VectorXd(f(minus))) / (2.0 * h);
    }
    return J;
}

/// Gradient of a scalar function by central differences.
template <class F, class Vector>
Eigen::VectorXd gradient(const F& f, const Vector& x, double h = 1e-6) {
    Eigen::VectorXd plus = x, minus = x, g(x.size());
    for (Eigen::Index j = 0; j < x.size(); ++j) {
        plus = x;
        minus = x;
        plus(j) += h;
        minus(j) -= h;
        g(j) = (f(plus) - f(minus)) / (2.0 * h);
    }
    return g;
}

}  // namespace teres::test
