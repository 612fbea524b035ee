// A linear model with Gaussian noise, and the Kalman filter on it in the covariance form of the textbooks:
// the truth that the unscented filters must equal. Written out without any code of the filters.
#pragma once

#include <Eigen/Dense>
#include <random>

namespace teres::test {

// x' = F x + B theta (2-3 states pushed by the parameters), theta' = theta; z = H x + noise.
struct LinearModel {
    Eigen::MatrixXd F, B, H;
    Eigen::VectorXd noise_variance;

    static LinearModel random(Eigen::Index nx, Eigen::Index p, Eigen::Index m, unsigned seed) {
        std::mt19937 engine(seed);
        std::normal_distribution<double> normal;
        const auto matrix = [&](Eigen::Index rows, Eigen::Index cols) {
            return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return normal(engine); }));
        };
        LinearModel model;
        model.F = 0.4 * matrix(nx, nx) / std::sqrt(static_cast<double>(nx));
        model.B = matrix(nx, p);
        model.H = matrix(m, nx);
        model.noise_variance = (0.1 + matrix(m, 1).array().abs()).matrix() * 0.05;
        return model;
    }
    // Augmented X = [x; theta].
    Eigen::MatrixXd augmented() const {
        const Eigen::Index nx = F.rows(), p = B.cols();
        Eigen::MatrixXd A = Eigen::MatrixXd::Identity(nx + p, nx + p);
        A.topLeftCorner(nx, nx) = F;
        A.topRightCorner(nx, p) = B;
        return A;
    }
    Eigen::MatrixXd observed() const {
        Eigen::MatrixXd result = Eigen::MatrixXd::Zero(H.rows(), F.rows() + B.cols());
        result.leftCols(F.rows()) = H;
        return result;
    }
};

struct KalmanFilter {
    Eigen::VectorXd x;
    Eigen::MatrixXd P;

    void predict(const Eigen::MatrixXd& A, const Eigen::MatrixXd& Q) {
        x = A * x;
        P = A * P * A.transpose() + Q;
    }
    // Joseph form. Rows whose z is NaN are left out. Returns the NIS.
    double correct(const Eigen::VectorXd& z, const Eigen::MatrixXd& H, const Eigen::VectorXd& noise_variance) {
        std::vector<Eigen::Index> rows;
        for (Eigen::Index i = 0; i < z.size(); ++i)
            if (!std::isnan(z(i))) rows.push_back(i);
        const Eigen::MatrixXd Hu = H(rows, Eigen::all);
        const Eigen::MatrixXd R = Eigen::VectorXd(noise_variance(rows)).asDiagonal();
        const Eigen::VectorXd r = z(rows) - Hu * x;
        const Eigen::MatrixXd S = Hu * P * Hu.transpose() + R;
        const Eigen::MatrixXd K = P * Hu.transpose() * S.inverse();
        const Eigen::MatrixXd J = Eigen::MatrixXd::Identity(x.size(), x.size()) - K * Hu;
        x += K * r;
        P = J * P * J.transpose() + K * R * K.transpose();
        return r.dot(S.inverse() * r);
    }
};

}  // namespace teres::test
