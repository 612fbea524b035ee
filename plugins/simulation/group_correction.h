// Corrects the shared factorisation K0 (made at parameters theta0) for each lane's own parameters:
//
//   K_l = K0 + sum_p (theta_pl - theta0_p) B_p,        B_p the stiffness of the tethers of parameter p at
//   theta_p = 1
//
// B_p acts on few nodes and, seen from the body, mostly on their affine motion: with Phi_p the affine modes
// of the nodes, U_p = B_p Phi_p and G_p = Phi_p^T U_p, the part U_p G_p^-1 U_p^T <= B_p is taken exactly
// (Woodbury identity):
//
//   K~_l^-1 r = y - W (I + D_l U^T W)^-1 D_l U^T y,     y = K0^-1 r, W = K0^-1 U, D_l = diag_p((theta_pl -
//   theta0_p) G_p^-1)
//
// It only serves as the metric of the quasi-Newton: what it leaves out costs iterations, never accuracy.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <vector>

#include "plugins/simulation/metric_solver.h"
#include "plugins/simulation/tether.h"

namespace teres {

class GroupCorrection {
  public:
    /// [setup]
    GroupCorrection(const std::vector<Tether>& tethers, std::size_t num_parameters, const BlockPattern& pattern,
                    const MetricSolver& metric, std::size_t max_lanes);

    /// [loop] The tethers where K0 is made: state x, parameters theta0 (one lane).
    void read(const std::vector<Tether>& tethers, const double* theta0, const Positions& x) noexcept;
    /// [loop] After K0 was factorised there. Needed by lanes whose parameters are not theta0.
    void renew(MetricSolver& metric, TaskTeam& team) noexcept;
    /// [loop] Prepares the lanes of one solve; theta: parameter p of lane l at p * stride + l. Renews itself with
    /// `metric` where that is needed and was not done.
    void set_lanes(const double* theta, std::size_t stride, std::size_t lanes, MetricSolver& metric,
                   TaskTeam& team) noexcept;
    /// [loop] y (rows and lanes of the metric) holds K0^-1 r and receives K~_l^-1 r for the first `open` lanes.
    void apply(float* y, std::size_t lanes, std::size_t open, TaskTeam& team) noexcept;

  private:
    struct Group {
        std::size_t parameter = 0;
        std::vector<std::size_t> tether;
        std::vector<NodeIndex> node;    // free ones, ascending
        std::vector<std::int32_t> row;  // three rows of the metric for each node
        Eigen::Index first = 0, count = 0;
        Eigen::MatrixXf U;  // rows of the nodes only
        Eigen::MatrixXd phi, B_phi;
        /// Place in `node`, -1: held.
        std::ptrdiff_t place(NodeIndex a) const {
            const auto found = std::lower_bound(node.begin(), node.end(), a);
            return found != node.end() && *found == a ? found - node.begin() : -1;
        }
    };
    std::vector<Group> groups_;
    Eigen::Index modes_ = 0;
    bool active_ = false;   // a lane's parameters differ from theta0
    bool renewed_ = false;  // W belongs to what was read
    std::vector<float> W_, C_;
    Eigen::MatrixXf UtW_, G_inverse_;  // G_inverse_: blocks on the diagonal
    std::vector<double> theta0_;
    struct Lane {
        Eigen::PartialPivLU<Eigen::MatrixXf> lu;  // of I + D_l U^T W
        Eigen::MatrixXf D, A;
        Eigen::VectorXf c, Dc;
    };
    std::vector<Lane> lane_;
    std::size_t rows_ = 0;
};

}  // namespace teres
