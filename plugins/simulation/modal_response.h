// First-order response of a vibrating body to small changes of force, by its lowest modes about one mean
// state:
//
//     q_k'' + (r_M + r_K w_k^2) q_k' + w_k^2 q_k = phi_k . f(t),     K phi_k = w_k^2 M phi_k, phi_k M phi_k =
//     1 dz = H [ sum_k phi_k q_k + (K^-1 - sum_k phi_k phi_k^T / w_k^2) f ]      the rest follows statically
//
// f piecewise linear between frames; the body rests before the first frame.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "plugins/simulation/cholesky.h"

namespace teres {

class ModalResponse {
  public:
    /// K: factorised stiffness of the free rows; mass per free row; count: number of modes. `subspace` is where the
    /// search for them starts (anywhere if it is empty) and receives where it ended: the start of one nearby.
    ModalResponse(Cholesky& K, const Eigen::VectorXd& mass, Eigen::Index count, Eigen::MatrixXd& subspace);

    Eigen::Index num_modes() const { return omega_.size(); }
    const Eigen::VectorXd& omega() const { return omega_; }  ///< ascending [rad/s]
    const Eigen::MatrixXd& modes() const { return modes_; }  ///< rows x modes

    /// Motion of the modes at a frame, from the modal forces (count) of this frame and the one before, h
    /// apart.
    struct State {
        Eigen::VectorXd q, v, force;  ///< empty: at rest
    };
    void advance(State& state, const Eigen::VectorXd& modal_force, double h, double rayleigh_mass_1_s,
                 double rayleigh_stiffness_s) const;

  private:
    Eigen::VectorXd omega_;
    Eigen::MatrixXd modes_;
};

}  // namespace teres
