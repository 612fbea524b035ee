#include "tools/peer_bench/peer_run.h"

#include <chrono>
#include <cmath>
#include <string>

#include "plugins/estimator/ro_ukf.h"
#include "plugins/estimator/ukf.h"
#include "tools/peer_bench/parallel.h"

namespace teres::peer {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

VectorXd gather(const std::vector<NodeIndex>& nodes, const VectorXd& x) {
    VectorXd out(3 * static_cast<Index>(nodes.size()));
    for (std::size_t a = 0; a < nodes.size(); ++a) out.segment<3>(3 * Index(a)) = x.segment<3>(3 * Index(nodes[a]));
    return out;
}

template <class Free>
void scatter(const std::vector<NodeIndex>& nodes, const Free& free, VectorXd& x) {
    for (std::size_t a = 0; a < nodes.size(); ++a)
        x.segment<3>(3 * Index(nodes[a])) = free.template segment<3>(3 * Index(a));
}

tl::unexpected<Error> no_solution(const Scene& scene, int k) {
    return not_usable(scene.folder.string() + ": filter step " + std::to_string(k) + ": a simulation has no solution");
}

/// What both filters need: lanes, start-of-step motion, settings.
struct Context {
    Context(const Scene& s, const PeerModel& m, const ParameterMap& p, std::size_t threads)
        : scene(s), model(m), parameters(p), motion(m.rest()) {
        for (std::size_t t = 0; t < threads; ++t) lanes.push_back(std::make_unique<PeerModel::Lane>(m));
    }
    const Scene& scene;
    const PeerModel& model;
    const ParameterMap& parameters;
    MotionState motion;  // corrected, at the start of the step
    std::vector<std::unique_ptr<PeerModel::Lane>> lanes;
    Index num_parameters() const { return parameters.size(); }
};

MatrixXd process_noise(const FilterSettings& settings) {
    return settings.process_noise_stdev.cwiseAbs2().asDiagonal();
}

class RoUkfRun {
  public:
    explicit RoUkfRun(Context& context)
        : c_(context),
          velocities_(context.scene.filter.velocities_in_state),
          num_positions_(3 * static_cast<Index>(context.model.free_nodes().size())),
          filter_(start(), context.parameters.prior_mean(), context.parameters.prior_covariance(),
                  {context.scene.filter.points, context.scene.filter.star_lambda}) {}

    Status step(int k, const VectorXd& z) {
        const auto& nodes = c_.model.free_nodes();
        if (c_.scene.filter.process_noise_stdev.size() > 0) filter_.add_process_noise(process_noise(c_.scene.filter));
        MatrixXd X = filter_.sigma_points();
        const MatrixXd theta_read = c_.parameters.read_back(X.bottomRows(c_.num_parameters()));
        const MatrixXd theta = c_.parameters.to_physical(X.bottomRows(c_.num_parameters()));
        X.bottomRows(c_.num_parameters()) = theta_read;
        MatrixXd Z(z.size(), X.cols());
        std::vector<char> solved(static_cast<std::size_t>(X.cols()), 0);
        parallel_for(solved.size(), c_.lanes.size(), [&](std::size_t i, std::size_t thread) {
            const auto column = Index(i);
            MotionState state = c_.motion;
            scatter(nodes, X.col(column), state.x);
            if (velocities_) scatter(nodes, X.col(column).segment(num_positions_, num_positions_), state.v);
            solved[i] = c_.model.advance(k, theta.col(column), *c_.lanes[thread], state);
            X.col(column).head(num_positions_) = gather(nodes, state.x);
            if (velocities_) X.col(column).segment(num_positions_, num_positions_) = gather(nodes, state.v);
            Z.col(column) = observe(c_.scene.points, state.x);
        });
        for (const char one : solved)
            if (!one) return no_solution(c_.scene, k);
        filter_.predict(X);
        const double variance = c_.scene.filter.observation_stdev_m * c_.scene.filter.observation_stdev_m;
        filter_.correct(z, Z, VectorXd::Constant(z.size(), variance));
        // The velocity of the next step: (corrected - start of step) / dt, unless it is part of the state.
        VectorXd x = c_.motion.x;
        scatter(nodes, filter_.mean(), x);
        if (velocities_)
            scatter(nodes, filter_.mean().segment(num_positions_, num_positions_), c_.motion.v);
        else
            c_.motion.v = (x - c_.motion.x) / c_.model.run().dt_s;
        c_.motion.p.resize(0);
        c_.motion.x = std::move(x);
        return {};
    }
    VectorXd mean() const { return filter_.theta(); }
    MatrixXd covariance() const { return filter_.covariance(); }

  private:
    VectorXd start() const {
        const auto& nodes = c_.model.free_nodes();
        VectorXd x = VectorXd::Zero((velocities_ ? 2 : 1) * num_positions_);
        x.head(num_positions_) = gather(nodes, c_.motion.x);
        return x;
    }
    Context& c_;
    bool velocities_;
    Index num_positions_;
    RoUkf filter_;
};

class ParameterUkfRun {
  public:
    explicit ParameterUkfRun(Context& context)
        : c_(context),
          filter_(context.parameters.prior_mean(), context.parameters.prior_covariance(),
                  {context.scene.filter.points, context.scene.filter.star_lambda}) {}

    Status step(int k, const VectorXd& z) {
        if (c_.scene.filter.process_noise_stdev.size() > 0) filter_.add_process_noise(process_noise(c_.scene.filter));
        const MatrixXd X = filter_.sigma_points();
        const MatrixXd theta = c_.parameters.to_physical(X);
        MatrixXd Z(z.size(), X.cols());
        std::vector<char> solved(static_cast<std::size_t>(X.cols()), 0);
        parallel_for(solved.size(), c_.lanes.size(), [&](std::size_t i, std::size_t thread) {
            MotionState state = c_.motion;
            solved[i] = c_.model.advance(k, theta.col(Index(i)), *c_.lanes[thread], state);
            Z.col(Index(i)) = observe(c_.scene.points, state.x);
        });
        for (const char one : solved)
            if (!one) return no_solution(c_.scene, k);
        const double variance = c_.scene.filter.observation_stdev_m * c_.scene.filter.observation_stdev_m;
        // The mean is that of the parameters read back from the model, the spread that of the points handed
        // to it.
        const VectorXd shift = (c_.parameters.read_back(X) - X).rowwise().mean();
        filter_.correct(z, Z, VectorXd::Constant(z.size(), variance));
        if (!shift.isZero(0.0)) filter_.shift_mean(shift);
        if (!c_.model.advance(k, c_.parameters.to_physical(filter_.mean()), *c_.lanes.front(), c_.motion))
            return no_solution(c_.scene, k);
        return {};
    }
    VectorXd mean() const { return filter_.mean(); }
    MatrixXd covariance() const { return filter_.covariance(); }

  private:
    Context& c_;
    Ukf filter_;
};

template <class Run>
Result<FilterRun> run_all(Context& context, const std::vector<VectorXd>& z, const Progress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    const Scene& scene = context.scene;
    Run run(context);
    FilterRun out;
    out.mean.resize(scene.compared_rows, context.num_parameters());
    out.stdev = out.mean;
    int k = 0;
    for (int row = 0; row < scene.compared_rows; ++row) {
        while (k < scene.expected_step[static_cast<std::size_t>(row)]) {
            ++k;
            TERES_TRY(run.step(k, z[static_cast<std::size_t>(observation_row(scene, k))]));
        }
        out.mean.row(row) = run.mean();
        out.stdev.row(row) = run.covariance().diagonal().cwiseMax(0.0).cwiseSqrt();
        if (progress) progress(row + 1, scene.compared_rows);
    }
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return out;
}

}  // namespace

Result<ParameterMap> peer_parameters(const Scene& scene) {
    const FilterSettings& filter = scene.filter;
    std::vector<ParameterSpec> specs;
    for (std::size_t i = 0; i < filter.names.size(); ++i) {
        const auto at = Index(i);
        ParameterSpec spec;
        spec.name = filter.names[i];
        spec.transform = filter.transform[i];
        spec.median = filter.mean(at);
        spec.stdev = filter.stdev(at);
        spec.lower = filter.lower(at);
        spec.upper = filter.upper(at);
        spec.filter_stdev = filter.filter_stdev[i];
        specs.push_back(std::move(spec));
    }
    auto map = ParameterMap::make(std::move(specs));
    if (!map) return invalid_input((scene.folder / "filter_settings.json").string() + ": " + map.error().text);
    return map;
}

Result<FilterRun> run_peer_filter(const Scene& scene, const PeerModel& model, const std::vector<VectorXd>& z,
                                  std::size_t threads, const Progress& progress) {
    TERES_TRY_ASSIGN(const ParameterMap parameters, peer_parameters(scene));
    const int last_step = scene.expected_step.back();
    if (last_step > model.last_step())
        return invalid_input((scene.folder / "scene.json").string() + ": the filter runs to step " +
                             std::to_string(last_step) + ", but the tool or load table ends at step " +
                             std::to_string(model.last_step()));
    Context context(scene, model, parameters, threads);
    if (scene.filter.kind == FilterKind::kRoUkf) return run_all<RoUkfRun>(context, z, progress);
    return run_all<ParameterUkfRun>(context, z, progress);
}

Comparison compare(const Scene& scene, const FilterRun& run) {
    Comparison out;
    const Eigen::RowVectorXd floor = 1e-6 * scene.expected_state.cwiseAbs().colwise().maxCoeff();
    for (Index row = 0; row < scene.expected_state.rows(); ++row)
        for (Index i = 0; i < scene.expected_state.cols(); ++i) {
            const double expected = scene.expected_state(row, i);
            const double scale = std::max({std::abs(expected), floor(i), 1e-300});
            const double difference = std::abs(run.mean(row, i) - expected) / scale;
            if (!(difference <= out.max_relative_difference)) out = {difference, static_cast<int>(row) + 1, i};
        }
    return out;
}

}  // namespace teres::peer
