#include "plugins/simulation/corotational.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include "plugins/simulation/tet_shape.h"

namespace teres {

namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;

// Rows e1 = (b-a)/|.|, e3 = e1 x (c-a)/|.|, e2 = e3 x e1.
Matrix3d first_edge_frame(const Vector3d& ab, const Vector3d& ac) {
    const Vector3d e1 = ab.normalized();
    const Vector3d e3 = e1.cross(ac).normalized();
    Matrix3d R;
    R.row(0) = e1;
    R.row(1) = e3.cross(e1);
    R.row(2) = e3;
    return R;
}

// Rotation Q of F = Q S; a reflection is moved into the smallest stretch.
Matrix3d polar_rotation(const Matrix3d& F) {
    const Eigen::JacobiSVD<Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Matrix3d U = svd.matrixU();
    if (U.determinant() * svd.matrixV().determinant() < 0.0) U.col(2) = -U.col(2);
    return U * svd.matrixV().transpose();
}

}  // namespace

Result<CorotationalTets> CorotationalTets::make(const TetMeshData& mesh, double poissons_ratio, ElementFrame frame) {
    TERES_TRY(check_poissons_ratio(poissons_ratio));
    CorotationalTets body;
    body.frame_ = frame;
    body.lambda_per_modulus_ = poissons_ratio / ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio));
    body.mu_per_modulus_ = 0.5 / (1.0 + poissons_ratio);
    body.tets_ = mesh.tets;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        TERES_TRY_ASSIGN(const TetShape shape, tet_shape(mesh, e));
        Matrix3d R0 = Matrix3d::Identity();
        if (frame == ElementFrame::kFirstEdge) R0 = first_edge_frame(shape.edges.col(0), shape.edges.col(1));
        Gradients local;
        local.col(0).setZero();
        local.rightCols<3>() = R0 * shape.edges;
        body.local_.push_back(local);
        body.gradient_.push_back(R0 * shape.gradient);
        body.volume_.push_back(shape.volume);
    }
    return body;
}

CorotationalTets::Deformed CorotationalTets::deform(std::size_t e, const Eigen::VectorXd& x) const noexcept {
    const auto& tet = tets_[e];
    const Vector3d a = x.segment<3>(3 * Index(tet[0]));
    Matrix3d edges;
    for (std::size_t i = 1; i < 4; ++i) edges.col(Index(i) - 1) = x.segment<3>(3 * Index(tet[i])) - a;
    const auto g = gradient_[e].rightCols<3>();
    Deformed now;
    if (frame_ == ElementFrame::kFirstEdge)
        now.R = first_edge_frame(edges.col(0), edges.col(1));
    else
        now.R = polar_rotation(edges * g.transpose()).transpose();
    const Matrix3d displacement_gradient = (now.R * edges - local_[e].rightCols<3>()) * g.transpose();
    now.strain = 0.5 * (displacement_gradient + displacement_gradient.transpose());
    return now;
}

void CorotationalTets::add_element_force(std::size_t e, const Deformed& now, double modulus,
                                         Eigen::VectorXd& force) const noexcept {
    const double lambda = lambda_per_modulus_ * modulus, mu = mu_per_modulus_ * modulus;
    const Matrix3d stress = lambda * now.strain.trace() * Matrix3d::Identity() + 2.0 * mu * now.strain;
    // f_k = -V0 R^T sig g_k
    const Gradients f = -volume_[e] * (now.R.transpose() * (stress * gradient_[e]));
    for (std::size_t i = 0; i < 4; ++i) force.segment<3>(3 * Index(tets_[e][i])) += f.col(Index(i));
}

void CorotationalTets::add_force(const Eigen::VectorXd& x, std::span<const double> modulus,
                                 Eigen::VectorXd& force) const noexcept {
    for (std::size_t e = 0; e < tets_.size(); ++e) add_element_force(e, deform(e, x), modulus[e], force);
}

void CorotationalTets::add_force_and_stiffness(const Eigen::VectorXd& x, std::span<const double> modulus,
                                               const BlockPattern& pattern, Eigen::VectorXd& force,
                                               std::vector<double>& values) const noexcept {
    for (std::size_t e = 0; e < tets_.size(); ++e) {
        const Deformed now = deform(e, x);
        add_element_force(e, now, modulus[e], force);
        const double lambda = volume_[e] * lambda_per_modulus_ * modulus[e];
        const double mu = volume_[e] * mu_per_modulus_ * modulus[e];
        const Gradients g = now.R.transpose() * gradient_[e];
        for (int i = 0; i < 4; ++i)
            for (int j = i; j < 4; ++j) {
                Matrix3d S = g.col(i) * (lambda * g.col(j)).transpose();
                S.noalias() += g.col(j) * (mu * g.col(i)).transpose();
                S.diagonal().array() += mu * g.col(i).dot(g.col(j));
                pattern.add(tets_[e][static_cast<std::size_t>(i)], tets_[e][static_cast<std::size_t>(j)],
                            block(e, i, j), S, values);
            }
    }
}

double CorotationalTets::energy(const Eigen::VectorXd& x, std::span<const double> modulus) const noexcept {
    double sum = 0.0;
    for (std::size_t e = 0; e < tets_.size(); ++e) {
        const Matrix3d strain = deform(e, x).strain;
        sum += volume_[e] * modulus[e] *
               (mu_per_modulus_ * strain.squaredNorm() + 0.5 * lambda_per_modulus_ * strain.trace() * strain.trace());
    }
    return sum;
}

}  // namespace teres
