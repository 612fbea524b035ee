#include "plugins/simulation/static_stvk.h"

#include <cmath>

#include "plugins/simulation/tet_shape.h"

namespace teres {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

Result<StvkTets> StvkTets::make(const TetMeshData& mesh, double poissons_ratio) {
    TERES_TRY(check_poissons_ratio(poissons_ratio));
    StvkTets body;
    body.lambda_per_modulus_ = poissons_ratio / ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio));
    body.mu_per_modulus_ = 0.5 / (1.0 + poissons_ratio);
    body.tets_ = mesh.tets;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        TERES_TRY_ASSIGN(const TetShape shape, tet_shape(mesh, e));
        body.gradient_.push_back(shape.gradient);
        body.volume_.push_back(shape.volume);
    }
    return body;
}

Matrix3d StvkTets::deformation_gradient(std::size_t e, const VectorXd& x) const noexcept {
    Matrix3d F = Matrix3d::Zero();
    for (std::size_t i = 0; i < 4; ++i)
        F += x.segment<3>(3 * Index(tets_[e][i])) * gradient_[e].col(Index(i)).transpose();
    return F;
}

Matrix3d StvkTets::second_piola(const Matrix3d& F, double modulus) const noexcept {
    const Matrix3d E = 0.5 * (F.transpose() * F - Matrix3d::Identity());
    return lambda_per_modulus_ * modulus * E.trace() * Matrix3d::Identity() + 2.0 * mu_per_modulus_ * modulus * E;
}

void StvkTets::add_force(const VectorXd& x, std::span<const double> modulus, VectorXd& force) const noexcept {
    for (std::size_t e = 0; e < tets_.size(); ++e) {
        const Matrix3d F = deformation_gradient(e, x);
        const Gradients f = -volume_[e] * (F * second_piola(F, modulus[e]) * gradient_[e]);
        for (std::size_t i = 0; i < 4; ++i) force.segment<3>(3 * Index(tets_[e][i])) += f.col(Index(i));
    }
}

void StvkTets::add_force_and_stiffness(const VectorXd& x, std::span<const double> modulus, const BlockPattern& pattern,
                                       VectorXd& force, std::vector<double>& values) const noexcept {
    for (std::size_t e = 0; e < tets_.size(); ++e) {
        const Matrix3d F = deformation_gradient(e, x);
        const Matrix3d S2 = second_piola(F, modulus[e]);
        const Gradients& g = gradient_[e];
        const Gradients f = -volume_[e] * (F * S2 * g);
        for (std::size_t i = 0; i < 4; ++i) force.segment<3>(3 * Index(tets_[e][i])) += f.col(Index(i));
        const double lambda = volume_[e] * lambda_per_modulus_ * modulus[e];
        const double mu = volume_[e] * mu_per_modulus_ * modulus[e];
        const Gradients Fg = F * g, Sg = volume_[e] * S2 * g;
        const Matrix3d FFt = F * F.transpose();
        for (int i = 0; i < 4; ++i)
            for (int j = i; j < 4; ++j) {
                Matrix3d K = lambda * Fg.col(i) * Fg.col(j).transpose() + mu * Fg.col(j) * Fg.col(i).transpose() +
                             mu * g.col(i).dot(g.col(j)) * FFt;
                K.diagonal().array() += g.col(i).dot(Sg.col(j));
                pattern.add(tets_[e][static_cast<std::size_t>(i)], tets_[e][static_cast<std::size_t>(j)],
                            block(e, i, j), K, values);
            }
    }
}

double StvkTets::energy(const VectorXd& x, std::span<const double> modulus) const noexcept {
    double sum = 0.0;
    for (std::size_t e = 0; e < tets_.size(); ++e) {
        const Matrix3d F = deformation_gradient(e, x);
        const Matrix3d E = 0.5 * (F.transpose() * F - Matrix3d::Identity());
        sum += volume_[e] * modulus[e] *
               (0.5 * lambda_per_modulus_ * E.trace() * E.trace() + mu_per_modulus_ * E.squaredNorm());
    }
    return sum;
}

int conjugate_gradient(const BlockPattern& pattern, const std::vector<double>& values, const VectorXd& b,
                       int max_iterations, double tolerance, VectorXd& y) noexcept {
    y.setZero(b.size());
    VectorXd r = b, p = b, q(b.size());
    double rho = r.squaredNorm();
    const double stop = tolerance * tolerance * rho;
    for (int k = 0; k < max_iterations; ++k) {
        if (rho <= stop) return k;
        q.setZero();
        pattern.multiply(values, p.data(), q.data());
        const double curvature = p.dot(q);
        if (curvature == 0.0) return k;
        const double alpha = rho / curvature;
        y += alpha * p;
        r -= alpha * q;
        const double next = r.squaredNorm();
        p = r + next / rho * p;
        rho = next;
    }
    return max_iterations;
}

}  // namespace teres
