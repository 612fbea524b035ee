// Overstress of a body with a memory, on the strain points that carry shear (second Piola-Kirchhoff, so that
// rotation leaves it alone), per branch:
//
//     H' + H/tau = g S_e'          Maxwell branch, S_e the elastic stress (long-term modulus = elastic one)
//     H = eta S_e'                 tau = 0: Kelvin-Voigt, eta [s]; in the linear range Rayleigh's stiffness
//     damping
//
// Over a step of length h, with z = exp(-h/tau), c = (1 - z) tau/h (Simo & Hughes, Computational
// Inelasticity, 10.3):
//     H_{n+1} = z H_n + g c (S_{n+1} - S_n)          Kelvin-Voigt: z = 0, g c = eta/h
// so a step needs the elastic energy times (1 + sum g c) and the constant stress  sum (z H_n - g c S_n).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "plugins/simulation/body.h"

namespace teres {

struct ViscousBranch {
    double strength = 0.0;  ///< g [-], or eta [s] when time_constant_s is 0
    double time_constant_s = 0.0;

    bool operator==(const ViscousBranch&) const = default;
};

/// S_e of every point of a set at x (3N), 6 per point: xx yy zz xy xz yz [Pa], of the bare law with the set's
/// weights; psi: its energy density, F: deformation gradient, 9 per point. Null outputs are not written.
void elastic_stress(const StrainPoints& set, const Material& material, const double* x, std::vector<double>& S,
                    std::vector<double>* psi, std::vector<double>* F);

class ViscousMemory {
  public:
    /// Forgets everything: the body is relaxed at rest.
    void start() { past_.clear(); }
    /// Writes the memory of `branches` into the body for a step of length h (stiffness_scale and prestress of
    /// shear sets).
    void enter_step(const std::vector<ViscousBranch>& branches, double h, std::vector<StrainPoints>& points) const;
    /// After the step: the elastic stress S of every shear set (in their order), at its end.
    void finish_step(const std::vector<ViscousBranch>& branches, double h,
                     const std::vector<std::vector<double>>& S);
    void finish_step(const std::vector<ViscousBranch>& branches, double h, const Body& body, const double* x);

  private:
    struct Past {
        std::vector<double> S;               // of the last step
        std::vector<std::vector<double>> H;  // per branch
    };
    std::vector<Past> past_;  // per shear set; empty: at rest
};

}  // namespace teres
