#include "plugins/simulation/modal_response.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <utility>

namespace teres {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {
constexpr int kMaxIterations = 12;   // of the subspace iteration ...
constexpr double kSettled = 1e-5;    // ... which ends when no w^2 asked for changes by more than this share
constexpr double kPhaseStep = 0.15;  // w h of a substep
}  // namespace

// Subspace iteration with Rayleigh-Ritz (Bathe, Finite Element Procedures, 11.6).
ModalResponse::ModalResponse(Cholesky& K, const VectorXd& mass, Index count, MatrixXd& subspace) {
    const Index rows = mass.size();
    count = std::min(count, rows);
    MatrixXd& X = subspace;
    if (X.rows() != rows || X.cols() != std::min(rows, count + 8)) {
        X.resize(rows, std::min(rows, count + 8));
        for (Index j = 0; j < X.cols(); ++j)
            for (Index i = 0; i < rows; ++i)
                X(i, j) = std::sin(1.0 + 0.7 * double(i % 97) * double(j + 1) + double(i) * 0.013);
    }
    VectorXd lambda = VectorXd::Zero(X.cols());
    for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
        const MatrixXd MX = mass.asDiagonal() * X;
        MatrixXd Y = MX;
        K.solve(Y);
        const MatrixXd k = Y.transpose() * MX,
                       m = Y.transpose() * mass.asDiagonal() * Y;  // Y^T K Y = Y^T M X
        const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> ritz(0.5 * (k + k.transpose()),
                                                                      0.5 * (m + m.transpose()));
        X = Y * ritz.eigenvectors();
        const VectorXd before = std::exchange(lambda, ritz.eigenvalues());
        if (((lambda - before).cwiseAbs() - kSettled * lambda.cwiseAbs()).head(count).maxCoeff() <= 0.0) break;
    }
    omega_ = lambda.head(count).cwiseMax(0.0).cwiseSqrt();
    modes_ = X.leftCols(count);
}

// Average acceleration in substeps short against the mode's period.
void ModalResponse::advance(State& s, const VectorXd& force, double h, double rM, double rK) const {
    if (s.q.size() == 0) {
        s.q = s.v = VectorXd::Zero(num_modes());
        s.force = force;
        return;
    }
    for (Index k = 0; k < num_modes(); ++k) {
        const double w2 = omega_(k) * omega_(k), c = rM + rK * w2;
        const int steps = std::max(1, static_cast<int>(std::ceil(omega_(k) * h / kPhaseStep)));
        const double dt = h / steps;
        double a = s.force(k) - c * s.v(k) - w2 * s.q(k);
        for (int i = 1; i <= steps; ++i) {
            const double f = s.force(k) + (force(k) - s.force(k)) * i / steps;
            const double v = s.v(k) + 0.5 * dt * a, q = s.q(k) + dt * s.v(k) + 0.25 * dt * dt * a;
            a = (f - c * v - w2 * q) / (1.0 + 0.5 * dt * c + 0.25 * dt * dt * w2);
            s.v(k) = v + 0.5 * dt * a;
            s.q(k) = q + 0.25 * dt * dt * a;
        }
    }
    s.force = force;
}

}  // namespace teres
