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
using Path = std::vector<SmoothedFrame>;

// Parts of the way to the linear solution that the line search tries.
constexpr double kSteps[] = {1.0, 0.5, 0.2};

std::span<double> span_of(MatrixXd& m) {
    return {m.data(), static_cast<std::size_t>(m.size())};
}

// Frame k about N(path_k, P_k).
struct Linearisation {
    bool valid = false;
    VectorXd zbar;
    MatrixXd H;
};

class IteratedSmoother {
  public:
    IteratedSmoother(ForwardModel& model, const ParameterMap& map, const std::vector<RecordedFrame>& frames,
                     std::size_t sweeps, const std::function<void(double)>& progress)
        : model_(model),
          map_(map),
          frames_(frames),
          points_(make_sigma_points(SigmaPointKind::kSimplex, map.size())),
          sweeps_(sweeps),
          progress_(progress) {}

    double cost(const Path& path) {
        double sum = ((path[0].mean - map_.prior_mean()).array() / map_.prior_stdev().array()).square().sum();
        MatrixXd lane = rest(1);
        for (std::size_t k = 0; k < frames_.size(); ++k) {
            const RecordedFrame& frame = frames_[k];
            for (Index i = 0; k > 0 && i < map_.size(); ++i)
                if (const double q = frame.change.noise_variance(i); q > 0.0)
                    sum += std::pow(path[k].mean(i) - path[k - 1].mean(i), 2) / q;
            MatrixXd Z;
            if (!advance(frame, path[k].mean, lane, Z)) continue;
            for (Index i = 0; i < frame.z.size(); ++i)
                if (frame.used[static_cast<std::size_t>(i)] != 0)
                    sum += std::pow(frame.z(i) - Z(i, 0), 2) / frame.noise_variance(i);
        }
        return sum;
    }

    std::vector<Linearisation> linearise(const Path& path) {
        std::vector<Linearisation> linear(frames_.size());
        MatrixXd lanes = rest(points_.unit.cols());
        for (std::size_t k = 0; k < frames_.size(); ++k) {
            const MatrixXd S = lower_root(path[k].covariance);
            const MatrixXd theta = (S * points_.unit).colwise() + path[k].mean;
            MatrixXd Z;
            linear[k].valid = advance(frames_[k], theta, lanes, Z);
            if (!linear[k].valid) continue;
            linear[k].zbar = Z * points_.weights;
            const MatrixXd Y = (Z.colwise() - linear[k].zbar) * points_.weights.asDiagonal() * points_.unit.transpose();
            linear[k].H = S.transpose().triangularView<Eigen::Upper>().solve(Y.transpose()).transpose();
        }
        return linear;
    }

    // Kalman filter over the linearised frames, from the prior, then the smoother.
    Path solve(const std::vector<Linearisation>& linear, const Path& about) const {
        std::vector<FilteredFrame> filtered(frames_.size());
        VectorXd mean = map_.prior_mean();
        MatrixXd root = map_.prior_stdev().asDiagonal();
        for (std::size_t k = 0; k < frames_.size(); ++k) {
            const RecordedFrame& frame = frames_[k];
            MatrixXd stack(2 * map_.size(), map_.size());
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
            }
            filtered[k].mean = mean;
            filtered[k].covariance = root * root.transpose();
        }
        Path path = smooth(filtered);
        for (SmoothedFrame& frame : path) frame.mean += map_.bring_mean_inside(frame.mean);
        return path;
    }

    std::int64_t lanes_not_converged() const { return lanes_not_converged_; }

  private:
    MatrixXd rest(Index lanes) const {
        VectorXd x(static_cast<Index>(model_.num_state()));
        model_.rest_state({x.data(), model_.num_state()});
        return x.replicate(1, lanes);
    }

    // Each lane starts from its own solution of the frame before. False: nothing usable came out.
    bool advance(const RecordedFrame& frame, const MatrixXd& theta, MatrixXd& lanes, MatrixXd& Z) {
        MatrixXd physical = map_.to_physical(theta);
        ForwardInputs inputs;
        inputs.time_s = 1e-6 * static_cast<double>(frame.stamp_us);
        inputs.region_force_n = frame.region_force_n;
        inputs.tool_position_m = frame.tool_position_m;
        const auto count = static_cast<std::size_t>(lanes.cols());
        const MatrixXd start = lanes;
        const ForwardReport report = model_.advance(inputs, span_of(physical), span_of(lanes), count);
        lanes_not_converged_ += report.lanes - report.lanes_converged;
        Z.resize(frame.z.size(), lanes.cols());
        if (lanes.allFinite()) model_.observe(span_of(lanes), span_of(Z), count);
        if (progress_) progress_(static_cast<double>(frames_done_++) / static_cast<double>(sweeps_ * frames_.size()));
        if (lanes.allFinite() && Z.allFinite()) return true;
        lanes = start;
        return false;
    }

    ForwardModel& model_;
    const ParameterMap& map_;
    const std::vector<RecordedFrame>& frames_;
    SigmaPoints points_;
    std::size_t sweeps_, frames_done_ = 0;
    const std::function<void(double)>& progress_;
    std::int64_t lanes_not_converged_ = 0;
};

}  // namespace

SmootherResult smooth_recording(ForwardModel& model, const ParameterMap& map, const std::vector<RecordedFrame>& frames,
                                int passes, const std::function<void(double)>& progress) {
    SmootherResult result;
    if (frames.empty()) return result;
    std::vector<FilteredFrame> filtered;
    for (const RecordedFrame& frame : frames) filtered.push_back(frame.filtered);
    result.frames = smooth(filtered);
    if (passes <= 0) return result;

    const auto sweeps = 2 + static_cast<std::size_t>(passes) * (1 + std::size(kSteps));
    IteratedSmoother smoother(model, map, frames, sweeps, progress);
    double least = smoother.cost(result.frames);
    const Path constant(frames.size(), result.frames.back());
    if (const double cost = smoother.cost(constant); cost < least) {
        least = cost;
        result.frames = constant;
    }
    result.cost.push_back(least);
    for (int pass = 0; pass < passes; ++pass) {
        const Path target = smoother.solve(smoother.linearise(result.frames), result.frames);
        bool better = false;
        for (const double step : kSteps) {
            Path trial = target;
            for (std::size_t k = 0; k < trial.size(); ++k)
                trial[k].mean = result.frames[k].mean + step * (target[k].mean - result.frames[k].mean);
            const double cost = smoother.cost(trial);
            if (cost >= least) continue;
            least = cost;
            result.frames = std::move(trial);
            better = true;
            break;
        }
        result.cost.push_back(least);
        if (!better) {
            // The path stays; its covariance is that of the newest linearisation about it.
            for (std::size_t k = 0; k < target.size(); ++k) result.frames[k].covariance = target[k].covariance;
            break;
        }
    }
    result.lanes_not_converged = smoother.lanes_not_converged();
    if (progress) progress(1.0);
    return result;
}

}  // namespace teres
