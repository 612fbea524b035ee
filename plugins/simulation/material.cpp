#include "plugins/simulation/material.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <string>

namespace teres {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// d psi / d l_i and its derivatives for laws written in principal stretches.
struct PrincipalLaw {
    double psi = 0.0;
    Vector3d first = Vector3d::Zero();   // d psi / d l_i
    Matrix3d second = Matrix3d::Zero();  // d2 psi / d l_i d l_j
};

void add_ogden_shear(const Vector3d& l, double G, double alpha, double weight, PrincipalLaw& out) {
    // W = 2 G/alpha^2 (sum lb_i^alpha - 3); with y_i = ln l_i - (ln J)/3:  dW/d(ln l_i) = 2 G/alpha (e_i -
    // mean e)
    const Vector3d log_l = l.array().log();
    const double mean_log = log_l.mean();
    Vector3d e;
    for (int i = 0; i < 3; ++i) e(i) = std::exp(alpha * (log_l(i) - mean_log));
    const double mean_e = e.mean();
    out.psi += weight * 2.0 * G / (alpha * alpha) * (e.sum() - 3.0);
    const double c = weight * 2.0 * G / alpha;
    for (int i = 0; i < 3; ++i) {
        const double t_i = c * (e(i) - mean_e);
        out.first(i) += t_i / l(i);
        for (int j = 0; j < 3; ++j) {
            // d t_i / d(ln l_j) = 2 G (e_i (d_ij - 1/3) - e_j/3 + mean(e)/3)
            const double delta = i == j ? 1.0 : 0.0;
            const double d = weight * 2.0 * G * (e(i) * (delta - 1.0 / 3.0) - e(j) / 3.0 + mean_e / 3.0);
            out.second(i, j) += d / (l(i) * l(j)) - delta * t_i / (l(i) * l(i));
        }
    }
}

void add_log_volume(const Vector3d& l, double K, double weight, PrincipalLaw& out) {
    const double log_j = l.array().log().sum();
    out.psi += weight * 0.5 * K * log_j * log_j;
    for (int i = 0; i < 3; ++i) {
        out.first(i) += weight * K * log_j / l(i);
        for (int j = 0; j < 3; ++j) out.second(i, j) += weight * K * (1.0 - (i == j ? log_j : 0.0)) / (l(i) * l(j));
    }
}

void add_corotational(const Vector3d& l, double mu, double lambda, PartWeights part, PrincipalLaw& out) {
    const Vector3d e = l.array() - 1.0;
    const double trace = e.sum();
    out.psi += part.shear * mu * e.squaredNorm() + part.volume * 0.5 * lambda * trace * trace;
    out.first += part.shear * 2.0 * mu * e + Vector3d::Constant(part.volume * lambda * trace);
    out.second += part.shear * 2.0 * mu * Matrix3d::Identity() + Matrix3d::Constant(part.volume * lambda);
}

void set_kronecker_geometric(const Matrix3d& S, Matrix9d& A) {
    // d(F S)/dF at fixed S: dP_ab/dF_cd = delta_ac S_db
    A.setZero();
    for (int b = 0; b < 3; ++b)
        for (int d = 0; d < 3; ++d)
            for (int a = 0; a < 3; ++a) A(a + 3 * b, a + 3 * d) += S(d, b);
}

}  // namespace

Result<Material> Material::make(const BodyData& body) {
    Material m;
    m.law_ = body.law;
    if (body.law == BodyLaw::kOgden) {
        if (!(body.shear_modulus_pa > 0.0))
            return invalid_input("body.shear_modulus_pa = " + std::to_string(body.shear_modulus_pa) +
                                 " must be above 0");
        if (!(body.bulk_modulus_pa > 0.0))
            return invalid_input("body.bulk_modulus_pa = " + std::to_string(body.bulk_modulus_pa) + " must be above 0");
        if (body.alpha == 0.0 || !std::isfinite(body.alpha))
            return invalid_input("body.alpha must be finite and not 0");
        m.mu_ = body.shear_modulus_pa;
        m.lambda_ = body.bulk_modulus_pa;
        m.alpha_ = body.alpha;
        return m;
    }
    const double E = body.youngs_modulus_pa;
    const double nu = body.poissons_ratio;
    if (!(E > 0.0)) return invalid_input("body.youngs_modulus_pa = " + std::to_string(E) + " must be above 0");
    if (!(nu > -1.0 && nu < 0.5))
        return invalid_input("body.poissons_ratio = " + std::to_string(nu) +
                             " must lie between -1 and 0.5 (exclusive)");
    m.mu_ = E / (2.0 * (1.0 + nu));
    m.lambda_ = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu));
    return m;
}

bool Material::energy(const Matrix3d& F, PartWeights part, double& psi) const {
    Matrix3d P;
    return stress(F, part, psi, P);
}

bool Material::stress(const Matrix3d& F, PartWeights part, double& psi, Matrix3d& P) const {
    switch (law_) {
        case BodyLaw::kStVK: {
            const Matrix3d E = 0.5 * (F.transpose() * F - Matrix3d::Identity());
            const double trace = E.trace();
            psi = part.shear * mu_ * E.squaredNorm() + part.volume * 0.5 * lambda_ * trace * trace;
            Matrix3d S = part.shear * 2.0 * mu_ * E;
            S.diagonal().array() += part.volume * lambda_ * trace;
            P.noalias() = F * S;
            return true;
        }
        case BodyLaw::kNeoHookean: {
            const double J = F.determinant();
            if (!(J > 0.0)) return false;
            const double log_j = std::log(J);
            const Matrix3d F_inv_T = F.inverse().transpose();
            psi = part.shear * (0.5 * mu_ * (F.squaredNorm() - 3.0) - mu_ * log_j) +
                  part.volume * 0.5 * lambda_ * log_j * log_j;
            P = part.shear * mu_ * (F - F_inv_T) + part.volume * lambda_ * log_j * F_inv_T;
            return true;
        }
        case BodyLaw::kOgden:
        case BodyLaw::kCorotational: {
            Matrix9d unused;
            return tangent(F, part, psi, P, unused);
        }
    }
    return false;
}

bool Material::tangent(const Matrix3d& F, PartWeights part, double& psi, Matrix3d& P, Matrix9d& A) const {
    switch (law_) {
        case BodyLaw::kStVK: {
            if (!stress(F, part, psi, P)) return false;
            const Matrix3d E = 0.5 * (F.transpose() * F - Matrix3d::Identity());
            Matrix3d S = part.shear * 2.0 * mu_ * E;
            S.diagonal().array() += part.volume * lambda_ * E.trace();
            set_kronecker_geometric(S, A);
            // F (dS/dF): dS = 2 mu dE + lambda tr(dE) I, dE = sym(F^T dF)
            const Matrix3d FFt = F * F.transpose();
            for (int d = 0; d < 3; ++d)
                for (int c = 0; c < 3; ++c)
                    for (int b = 0; b < 3; ++b)
                        for (int a = 0; a < 3; ++a) {
                            double v = part.shear * mu_ * F(a, d) * F(c, b) + part.volume * lambda_ * F(a, b) * F(c, d);
                            if (b == d) v += part.shear * mu_ * FFt(a, c);
                            A(a + 3 * b, c + 3 * d) += v;
                        }
            return true;
        }
        case BodyLaw::kNeoHookean: {
            if (!stress(F, part, psi, P)) return false;
            const double log_j = std::log(F.determinant());
            const Matrix3d G = F.inverse().transpose();
            const double factor = part.shear * mu_ - part.volume * lambda_ * log_j;
            for (int d = 0; d < 3; ++d)
                for (int c = 0; c < 3; ++c)
                    for (int b = 0; b < 3; ++b)
                        for (int a = 0; a < 3; ++a) {
                            double v = factor * G(a, d) * G(c, b) + part.volume * lambda_ * G(a, b) * G(c, d);
                            if (a == c && b == d) v += part.shear * mu_;
                            A(a + 3 * b, c + 3 * d) = v;
                        }
            return true;
        }
        case BodyLaw::kOgden:
        case BodyLaw::kCorotational:
            break;
    }
    // Isotropic laws in principal stretches: S = sum_i s_i N_i N_i^T with s_i = (1/l_i) d psi/d l_i (Bonet &
    // Wood 6.6).
    const Matrix3d E2 = F.transpose() * F - Matrix3d::Identity();  // C - I, diagonalised for accuracy near rest
    Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(E2);
    const Vector3d c = eigen.eigenvalues().array() + 1.0;
    if (!(c.minCoeff() > 1e-12) || F.determinant() <= 0.0) return false;
    const Vector3d l = c.array().sqrt();
    const Matrix3d& N = eigen.eigenvectors();
    PrincipalLaw w;
    if (law_ == BodyLaw::kOgden) {
        if (part.shear != 0.0) add_ogden_shear(l, mu_, alpha_, part.shear, w);
        if (part.volume != 0.0) add_log_volume(l, lambda_, part.volume, w);
    } else {
        add_corotational(l, mu_, lambda_, part, w);
    }
    psi = w.psi;
    const Vector3d s = w.first.array() / l.array();
    const Matrix3d S = N * s.asDiagonal() * N.transpose();
    P.noalias() = F * S;

    // Material tangent in principal axes: dS_ii/dE_jj = (1/l_j) d s_i/d l_j, dS_ij/dE_ij pair = (s_j -
    // s_i)/(c_j - c_i) (times 2 for the symmetric pair); equal stretches take the limit.
    Matrix3d H;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            H(i, j) = (w.second(i, j) / l(i) - (i == j ? w.first(i) / (l(i) * l(i)) : 0.0)) / l(j);
    set_kronecker_geometric(S, A);
    // A += G H G^T + sum over pairs 2 m g g^T: dE_ij = sym(N_i . F^T dF N_j), its columns f_i N_j^T stacked
    const Matrix3d f = F * N;
    const auto stacked = [](const Matrix3d& m) -> Eigen::Matrix<double, 9, 1> {
        return Eigen::Map<const Eigen::Matrix<double, 9, 1>>(m.data());
    };
    Eigen::Matrix<double, 9, 6> G, D;  // A += D G^T
    for (int i = 0; i < 3; ++i) G.col(i) = stacked(f.col(i) * N.col(i).transpose());
    D.leftCols<3>().noalias() = G.leftCols<3>() * H;
    for (int i = 0, k = 3; i < 3; ++i)
        for (int j = i + 1; j < 3; ++j, ++k) {
            const double gap = c(j) - c(i);
            const double m =
                std::abs(gap) > 1e-7 ? 2.0 * (s(j) - s(i)) / gap : H(i, i) - H(i, j);  // limit (1/l) d(s_i - s_j)/d l_i
            G.col(k) = stacked(0.5 * (f.col(i) * N.col(j).transpose() + f.col(j) * N.col(i).transpose()));
            D.col(k) = 2.0 * m * G.col(k);
        }
    A.noalias() += D.lazyProduct(G.transpose());
    return true;
}

}  // namespace teres
