#include "plugins/estimator/attachment.h"

#include <fmt/format.h>

#include <algorithm>

#include "plugins/estimator/probability.h"

namespace teres {
namespace {

// The atlas is never surer than this: a node must be able to change its mind.
constexpr double kSurest = 1e-3;
// Nodes of a group share one stiffness in the model only; no estimate of the group is surer than this of a
// node.
constexpr double kNodeSpread = 1.0 / 3.0;  // of the prior standard deviation

}  // namespace

Result<AttachmentMap> AttachmentMap::make(const ForwardModel& model, const ParameterMap& parameters) {
    AttachmentMap map;
    const std::size_t num_nodes = model.num_attachment_nodes();
    std::vector<double> sum(model.num_parameters(), 0.0), count(model.num_parameters(), 0.0);
    for (std::size_t n = 0; n < num_nodes; ++n) {
        const AttachmentNode node = model.attachment_node(n);
        if (node.parameter < 0 || static_cast<std::size_t>(node.parameter) >= model.num_parameters())
            return invalid_input(fmt::format("attachment node {}: parameter {} does not exist (the model has {})",
                                             node.node_id, node.parameter, model.num_parameters()));
        const ForwardParameter parameter = model.parameter(static_cast<std::size_t>(node.parameter));
        if (!(parameter.attachment_threshold > 0.0))
            return invalid_input(fmt::format("attachment node {}: parameter {} has no attachment threshold > 0",
                                             node.node_id, parameter.name));
        if (!(node.prior_probability >= 0.0 && node.prior_probability <= 1.0))
            return invalid_input(fmt::format("attachment node {}: prior probability {} is outside [0, 1]", node.node_id,
                                             node.prior_probability));
        const double prior = std::clamp(node.prior_probability, kSurest, 1.0 - kSurest);
        map.node_ids_.push_back(node.node_id);
        map.parameter_.push_back(node.parameter);
        map.threshold_.push_back(parameters.to_filter(node.parameter, parameter.attachment_threshold));
        map.offset_.push_back(probit(prior));
        map.node_spread_.push_back(kNodeSpread * parameters.prior_stdev()(node.parameter));
        sum[static_cast<std::size_t>(node.parameter)] += prior;
        count[static_cast<std::size_t>(node.parameter)] += 1.0;
    }
    for (std::size_t n = 0; n < num_nodes; ++n) {
        const auto group = static_cast<std::size_t>(map.parameter_[n]);
        map.offset_[n] -= probit(sum[group] / count[group]);
    }
    return map;
}

void AttachmentMap::probabilities(const Eigen::VectorXd& theta, const Eigen::VectorXd& stdev,
                                  std::vector<double>& out) const {
    out.resize(node_ids_.size());
    for (std::size_t n = 0; n < node_ids_.size(); ++n) {
        const Eigen::Index i = parameter_[n];
        const double spread = std::hypot(stdev(i), node_spread_[n]) / std::hypot(1.0, kNodeSpread);
        out[n] = normal_cdf((theta(i) - threshold_[n]) / spread + offset_[n]);
    }
}

}  // namespace teres
