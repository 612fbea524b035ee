// Where the ligament holds: probability per surface node, from the stiffness of the node's group.
//
//     group   z_g = (m - t) / s'      s'^2 = (s^2 + b^2) / (1 + (b/s0)^2)
//     node    P_n = Phi(z_g + probit(pi_n) - probit(mean of pi over the group))
//
// t: threshold stiffness; m, s: mean and standard deviation; s0: that of the prior; b = s0/3: how far nodes
// of one group differ; all in filter coordinates. s' = s0 at the prior, so P_n starts as the atlas' pi_n.
//
// Phi(z_g) is the probability that the group's stiffness exceeds the threshold. The atlas may think more of
// one node of the group than of another (pi_n): that difference is kept on the probit scale, where sure
// knowledge of the group outweighs it.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <vector>

#include "core/extensions/forward_model.h"
#include "plugins/estimator/parameter_map.h"

namespace teres {

class AttachmentMap {
  public:
    /// Errors (kInvalidInput): a node names a parameter that does not exist or has no threshold; probability
    /// outside [0, 1].
    static Result<AttachmentMap> make(const ForwardModel& model, const ParameterMap& parameters);

    const std::vector<std::int32_t>& node_ids() const { return node_ids_; }
    /// theta, stdev: filter coordinates. out: one probability per node_ids().
    void probabilities(const Eigen::VectorXd& theta, const Eigen::VectorXd& stdev, std::vector<double>& out) const;

  private:
    std::vector<std::int32_t> node_ids_;
    std::vector<Eigen::Index> parameter_;
    std::vector<double> threshold_;    // filter coordinates
    std::vector<double> offset_;       // probit scale
    std::vector<double> node_spread_;  // filter coordinates
};

}  // namespace teres
