// St. Venant-Kirchhoff tetrahedra, total Lagrangian, one strain point each (no remedy against locking: the
// product's body is body.h; this one reproduces recorded static runs).
//
//   F = sum_k x_k g_k^T, E = (F^T F - I)/2, S2 = lambda tr(E) I + 2 mu E
//   f_k  = -V0 F S2 g_k [N] S_kl = V0 ((g_k . S2 g_l) I + lambda F g_k (F g_l)^T + mu F g_l (F g_k)^T + mu
//   (g_k . g_l) F F^T)            [N/m]
//
// and a static equilibrium by a fixed number of Newton steps whose linear solver may be a truncated conjugate
// gradient.
#pragma once

#include <Eigen/Core>

#include "core/result.h"
#include "plugins/simulation/elastic_tets.h"

namespace teres {

class StvkTets final : public ElasticTets {
  public:
    /// Errors (kInvalidInput): nu outside (-1, 0.5), a node id outside the mesh, a degenerate tetrahedron.
    static Result<StvkTets> make(const TetMeshData& mesh, double poissons_ratio);

    void add_force(const Eigen::VectorXd& x, std::span<const double> modulus,
                   Eigen::VectorXd& force) const noexcept override;
    void add_force_and_stiffness(const Eigen::VectorXd& x, std::span<const double> modulus, const BlockPattern& pattern,
                                 Eigen::VectorXd& force, std::vector<double>& values) const noexcept override;
    double energy(const Eigen::VectorXd& x, std::span<const double> modulus) const noexcept;

  private:
    using Gradients = Eigen::Matrix<double, 3, 4>;
    Eigen::Matrix3d deformation_gradient(std::size_t e, const Eigen::VectorXd& x) const noexcept;
    Eigen::Matrix3d second_piola(const Eigen::Matrix3d& F, double modulus) const noexcept;

    double lambda_per_modulus_ = 0.0;
    double mu_per_modulus_ = 0.0;
    std::vector<Gradients> gradient_;
};

/// Plain conjugate gradients for A y = b (A symmetric, BlockPattern values) from y = 0. Stops after
/// max_iterations or when |r| <= tolerance |b|. Returns the iterations done.
int conjugate_gradient(const BlockPattern& pattern, const std::vector<double>& values, const Eigen::VectorXd& b,
                       int max_iterations, double tolerance, Eigen::VectorXd& y) noexcept;

}  // namespace teres
