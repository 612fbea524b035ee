// Linear co-rotational tetrahedra: Hooke's law on the displacement that is left after the element's rotation.
//
//   u_k = R (x_k - x_a) - R0 (X_k - X_a)        displacement in the element frame, k over the vertices a, b,
//   c, d   [m] eps = sym(sum_k u_k g_k^T)                  g_k shape gradients in the frame at rest sig =
//   lambda tr(eps) I + 2 mu eps [Pa] f_k = -V0 R^T sig g_k [N] S_kl = V0 (lambda g'_k g'_l^T + mu g'_l g'_k^T
//   + mu (g'_k . g'_l) I),   g' = R^T g                              [N/m]
//
// S leaves out dR/dx, as the reference implementations do ("large" displacements): exact at rest, symmetric
// and positive semi-definite everywhere. The rotation R comes from one of two frames.
//   kFirstEdge: Gram-Schmidt on a->b and the face abc, in the file's vertex order: cheap, but the result
//   depends on
//               that order and the force is not the gradient of an energy.
//   kPolar:     R^T = polar rotation of the deformation gradient: independent of the order, f = -d/dx of
//               V0 (mu |S-I|^2 + lambda/2 tr(S-I)^2), S the right stretch.
#pragma once

#include <Eigen/Core>

#include "core/result.h"
#include "plugins/simulation/elastic_tets.h"

namespace teres {

enum class ElementFrame { kFirstEdge, kPolar };

class CorotationalTets final : public ElasticTets {
  public:
    /// Errors (kInvalidInput): nu outside (-1, 0.5), a node id outside the mesh, a degenerate tetrahedron.
    static Result<CorotationalTets> make(const TetMeshData& mesh, double poissons_ratio, ElementFrame frame);

    void add_force(const Eigen::VectorXd& x, std::span<const double> modulus,
                   Eigen::VectorXd& force) const noexcept override;
    void add_force_and_stiffness(const Eigen::VectorXd& x, std::span<const double> modulus, const BlockPattern& pattern,
                                 Eigen::VectorXd& force, std::vector<double>& values) const noexcept override;
    /// Stored energy [J]; with kFirstEdge the energy of the rotated strain, of which the force is not the
    /// gradient.
    double energy(const Eigen::VectorXd& x, std::span<const double> modulus) const noexcept;

  private:
    using Gradients = Eigen::Matrix<double, 3, 4>;
    struct Deformed {
        Eigen::Matrix3d R;       // rows: axes of the element frame
        Eigen::Matrix3d strain;  // in the element frame
    };
    Deformed deform(std::size_t e, const Eigen::VectorXd& x) const noexcept;
    void add_element_force(std::size_t e, const Deformed& now, double modulus, Eigen::VectorXd& force) const noexcept;

    ElementFrame frame_ = ElementFrame::kFirstEdge;
    double lambda_per_modulus_ = 0.0;  // lambda / E
    double mu_per_modulus_ = 0.0;      // mu / E
    std::vector<Gradients> gradient_;  // in the element frame at rest
    std::vector<Gradients> local_;     // R0 (X_k - X_a)
};

}  // namespace teres
