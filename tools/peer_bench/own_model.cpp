#include "tools/peer_bench/own_model.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/peer_bench/parallel.h"

namespace teres::peer {

using Eigen::Index;
using Eigen::Map;
using Eigen::VectorXd;

namespace {

// Velocity damping: within 0.05 .. 20 1/s (2 sigma); a body that rings for minutes or stops at once needs no
// estimate.
constexpr double kDampingMedian = 1.0;
constexpr double kDampingLogStdev = 1.5;
// A stiffness below this share of its prior median holds nothing any more.
constexpr double kLeastShare = 1e-6;

}  // namespace

OwnModel::OwnModel(const Scene& scene, const PeerModel& model, std::size_t threads) : scene_(scene), model_(model) {
    const double infinity = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < scene.filter.names.size(); ++i) {
        const auto at = Index(i);
        ForwardParameter p{};
        p.name = scene.filter.names[i].c_str();
        p.unit = "";
        p.prior_median = scene.filter.mean(at);
        if (scene.filter.filter_stdev[i] > 0.0)
            p.prior_log_stdev = scene.filter.filter_stdev[i];
        else
            p.prior_stdev = scene.filter.stdev(at);
        p.lower = kLeastShare * p.prior_median;
        p.upper = infinity;
        parameters_.push_back(p);
    }
    if (!is_static())
        parameters_.push_back({"velocity_damping", "1/s", kDampingMedian, kDampingLogStdev, 0.0, 1e-4, 1e3, 0.0});
    for (std::size_t j = 0; j < scene.points.size(); ++j) {
        const auto& weight = scene.points[j].weight;
        const bool far =
            std::any_of(weight.begin(), weight.end(), [](double w) { return std::abs(w) > kLargestWeight; });
        (far ? refused_ : kept_).push_back(j);
        if (!far) points_.push_back(scene.points[j]);
    }
    for (std::size_t t = 0; t < threads; ++t) lanes_.push_back(std::make_unique<PeerModel::Lane>(model));
}

void OwnModel::rest_state(std::span<double> x) const {
    const MotionState rest = model_.rest();
    std::fill(x.begin(), x.end(), 0.0);
    std::copy(rest.x.begin(), rest.x.end(), x.begin());
}

ForwardReport OwnModel::advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                                std::size_t lanes) noexcept {
    const auto dofs = Index(3 * num_nodes()), rows = Index(num_state()), p = Index(parameters_.size());
    const double dt = model_.run().dt_s;
    const int last = static_cast<int>(std::lround(inputs.time_s / dt));
    const int first = is_static() ? last : last - static_cast<int>(std::lround(inputs.dt_s / dt)) + 1;
    std::vector<char> solved(lanes, 1);
    parallel_for(lanes, lanes_.size(), [&](std::size_t lane, std::size_t thread) {
        Map<VectorXd> column(X.data() + Index(lane) * rows, rows);
        const Map<const VectorXd> parameters(theta.data() + Index(lane) * p, p);
        MotionState state{column.head(dofs), VectorXd::Zero(dofs), {}};
        if (!is_static()) state.v = column.tail(dofs);
        for (int k = first; k <= last; ++k) {
            solved[lane] = solved[lane] &&
                           model_.advance(k, parameters.head(Index(num_folder_parameters())), *lanes_[thread], state);
            if (!is_static()) state.v *= std::exp(-dt * parameters(p - 1));
        }
        column.head(dofs) = state.x;
        if (!is_static()) column.tail(dofs) = state.v;
    });
    ForwardReport report{};
    report.lanes = static_cast<std::int32_t>(lanes);
    report.lanes_converged = static_cast<std::int32_t>(std::count(solved.begin(), solved.end(), 1));
    report.iterations = 1;
    report.relative_residual = report.lanes_converged == report.lanes ? 0.0 : 1.0;
    return report;
}

void OwnModel::observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept {
    const auto rows = Index(num_state()), out = Index(3 * points_.size());
    for (std::size_t lane = 0; lane < lanes; ++lane) {
        const Map<const VectorXd> column(X.data() + Index(lane) * rows, rows);
        Map<VectorXd>(Z.data() + Index(lane) * out, out) = peer::observe(points_, column.head(Index(3 * num_nodes())));
    }
}

}  // namespace teres::peer
