// Hyperelastic laws of the body, each split into a shear part and a volume part so that the volume part can
// be averaged over nodal patches (the remedy against volumetric locking, strain_points.h).
//
//   psi(F) = psi_shear(F) + psi_volume(F)            energy density of the reference volume [J/m^3]
//   P      = d psi / d F                             first Piola-Kirchhoff stress [Pa]
//   A      = d P / d F                               tangent, 9x9, F and P stacked column by column [Pa]
//
//   law           psi_shear                                  psi_volume
//   StVK          mu tr(E^2)                                 lambda/2 tr(E)^2            E = (F^T F - I)/2
//   neo-Hookean   mu/2 (tr C - 3) - mu ln J                  lambda/2 (ln J)^2           C = F^T F, J = det F
//   Ogden         2 G/alpha^2 sum(lb_i^alpha - 1)            K/2 (ln J)^2                lb_i = J^(-1/3) l_i
//   corotational  mu sum (l_i - 1)^2                         lambda/2 (sum l_i - 3)^2    l_i principal
//   stretches
//
// Bonet & Wood, Nonlinear Continuum Mechanics for FE Analysis, chapters 6 and 7; Ogden in the one-term form
// of CASE.md.
#pragma once

#include <Eigen/Core>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// How much of each part of the energy a strain point carries.
struct PartWeights {
    double shear = 1.0;
    double volume = 1.0;
};

class Material {
  public:
    /// Errors (kInvalidInput): a modulus that is not positive, nu outside (-1, 0.5), alpha = 0.
    static Result<Material> make(const BodyData& body);

    BodyLaw law() const { return law_; }
    double mu() const { return mu_; }          ///< shear modulus of small strain [Pa]
    double lambda() const { return lambda_; }  ///< first Lame constant of small strain; Ogden: bulk modulus K [Pa]
    double alpha() const { return alpha_; }

    /// False if the law is undefined at F (det F <= 0 where a logarithm or a principal stretch is needed).
    bool energy(const Eigen::Matrix3d& F, PartWeights part, double& psi) const;
    bool stress(const Eigen::Matrix3d& F, PartWeights part, double& psi, Eigen::Matrix3d& P) const;
    bool tangent(const Eigen::Matrix3d& F, PartWeights part, double& psi, Eigen::Matrix3d& P, Matrix9d& A) const;

  private:
    BodyLaw law_ = BodyLaw::kStVK;
    double mu_ = 0.0;
    double lambda_ = 0.0;
    double alpha_ = 0.0;
};

}  // namespace teres
