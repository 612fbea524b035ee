#include "plugins/estimator/iterated_smoother.h"

#include <cmath>
#include <limits>

#include "plugins/estimator/ensemble_correction.h"
#include "plugins/estimator/sigma_points.h"

namespace teres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::span<double> span_of(MatrixXd& m) {
    return {m.data(), static_cast<std::size_t>(m.size())};
}

// Frame k about N(m_k, P_k).
struct Linearisation {
    bool valid = false;
    VectorXd zbar;
    MatrixXd H;
    double misfit = 0.0;  // |z - h(m_k)|^2_R
};

class Pass {
  public:
    Pass(ForwardModel& model, const ParameterMap& map)
        : model_(model), map_(map), points_(make_sigma_points(SigmaPointKind::kSimplex, map.size())) {}

    // Lanes: the sigma points and, last, the mean itself. Each lane starts from its own solution of the frame
    // before.
    Linearisation linearise(const RecordedFrame& frame, const SmoothedFrame& about,
                            std::int64_t& not_converged) {
        const Index p = map_.size(), r = points_.unit.cols();
        const MatrixXd S = lower_root(about.covariance);
        MatrixXd theta(p, r + 1);
        theta.leftCols(r) = (S * points_.unit).colwise() + about.mean;
        theta.col(r) = about.mean;
        MatrixXd physical = map_.to_physical(theta);
        if (lanes_.size() == 0) {
            VectorXd rest(static_cast<Index>(model_.num_state()));
            model_.rest_state({rest.data(), model_.num_state()});
            lanes_ = rest.replicate(1, r + 1);
        }
        ForwardInputs inputs;
        inputs.time_s = 1e-6 * static_cast<double>(frame.stamp_us);
        inputs.region_force_n = frame.region_force_n;
        inputs.tool_position_m = frame.tool_position_m;
        const auto lanes = static_cast<std::size_t>(r + 1);
        const MatrixXd start = lanes_;
        const ForwardReport report = model_.advance(inputs, span_of(physical), span_of(lanes_), lanes);
        not_converged += report.lanes - report.lanes_converged;
        MatrixXd Z(frame.z.size(), r + 1);
        Linearisation result;
        if (lanes_.allFinite()) model_.observe(span_of(lanes_), span_of(Z), lanes);
        if (!lanes_.allFinite() || !Z.allFinite()) {
            lanes_ = start;
            return result;
        }
        const MatrixXd points = Z.leftCols(r);
        result.valid = true;
        result.zbar = points * points_.weights;
        const MatrixXd Y =
            (points.colwise() - result.zbar) * points_.weights.asDiagonal() * points_.unit.transpose();
        result.H = S.transpose().triangularView<Eigen::Upper>().solve(Y.transpose()).transpose();
        for (Index i = 0; i < frame.z.size(); ++i)
            if (frame.used[static_cast<std::size_t>(i)] != 0)
                result.misfit += std::pow(frame.z(i) - Z(i, r), 2) / frame.noise_variance(i);
        return result;
    }

  private:
    ForwardModel& model_;
    const ParameterMap& map_;
    SigmaPoints points_;
    MatrixXd lanes_;
};

double walk_cost(const ParameterMap& map, const std::vector<RecordedFrame>& frames,
                 const std::vector<SmoothedFrame>& path) {
    double cost = ((path[0].mean - map.prior_mean()).array() / map.prior_stdev().array()).square().sum();
    for (std::size_t k = 1; k < path.size(); ++k)
        for (Index i = 0; i < map.size(); ++i)
            if (const double q = frames[k].change.noise_variance(i); q > 0.0)
                cost += std::pow(path[k].mean(i) - path[k - 1].mean(i), 2) / q;
    return cost;
}

// Kalman filter over the linearised frames, from the prior.
std::vector<FilteredFrame> filter_linear(const ParameterMap& map, const std::vector<RecordedFrame>& frames,
                                         const std::vector<Linearisation>& linear,
                                         const std::vector<SmoothedFrame>& about) {
    std::vector<FilteredFrame> filtered(frames.size());
    VectorXd mean = map.prior_mean();
    MatrixXd root = map.prior_stdev().asDiagonal();
    for (std::size_t k = 0; k < frames.size(); ++k) {
        const RecordedFrame& frame = frames[k];
        MatrixXd stack(2 * map.size(), map.size());
        stack << (frame.change.factor.asDiagonal() * root).transpose(),
            MatrixXd(frame.change.noise_variance.cwiseSqrt().asDiagonal());
        root = lower_root_of_gram(stack);
        filtered[k].predicted_covariance = root * root.transpose();
        if (linear[k].valid) {
            const Innovation innovation{frame.z - linear[k].zbar - linear[k].H * (mean - about[k].mean),
                                        linear[k].H * root};
            const Correction correction = ensemble_correction(innovation, frame.noise_variance, frame.used);
            mean += root * correction.weights;
            root = root * correction.root;
            mean += map.bring_mean_inside(mean);
        }
        filtered[k].mean = mean;
        filtered[k].covariance = root * root.transpose();
    }
    return filtered;
}

}  // namespace

SmootherResult smooth_recording(ForwardModel& model, const ParameterMap& map,
                                const std::vector<RecordedFrame>& frames, int passes,
                                const std::function<bool(std::size_t)>& progress) {
    SmootherResult result;
    if (frames.empty()) return result;
    std::vector<FilteredFrame> filtered;
    for (const RecordedFrame& frame : frames) filtered.push_back(frame.filtered);
    std::vector<SmoothedFrame> path = smooth(filtered);
    result.frames = path;
    double least = std::numeric_limits<double>::infinity();
    std::size_t done = 0;
    for (int pass = 0; pass < passes; ++pass) {
        Pass run(model, map);
        std::vector<Linearisation> linear;
        double cost = walk_cost(map, frames, path);
        for (std::size_t k = 0; k < frames.size(); ++k) {
            linear.push_back(run.linearise(frames[k], path[k], result.lanes_not_converged));
            cost += linear.back().misfit;
            if (progress && !progress(++done)) return result;
        }
        result.cost.push_back(cost);
        if (cost < least) {
            least = cost;
            result.best = result.cost.size() - 1;
            result.frames = path;
        }
        path = smooth(filter_linear(map, frames, linear, path));
    }
    return result;
}

}  // namespace teres
