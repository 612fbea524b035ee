#include "tools/peer_bench/own_run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

namespace teres::peer {

using Eigen::Index;
using Eigen::VectorXd;

// The product's defaults, but for the noise: the recordings carry rounding only (handed in per marker), and
// the model is the generator's own, so there is no model error to allow for. The walk is ten times the
// default's because the priors of these folders are narrow (1 to 3 %) and some are wrong by far more.
BoundaryEstimatorOptions own_options(double model_error_sigma_m) {
    BoundaryEstimatorOptions options;
    options.walk.noise_per_sqrt_s = model_error_sigma_m > 0.0 ? 0.03 : 0.3;
    options.relative_model_error = 0.0;
    options.model_error_sigma_m = model_error_sigma_m;
    options.gate.probability = 1.0;
    return options;
}

double rounding_sigma(const Scene& scene, std::size_t point, const VectorXd& z) {
    const int digits = scene.recording.significant_digits;
    if (digits <= 0) return 0.0;
    double largest = 0.0;
    for (Index axis = 0; axis < 3; ++axis) {
        const double size = std::abs(z(3 * Index(point) + axis));
        const double quantum = size > 0.0 ? std::pow(10.0, std::floor(std::log10(size)) - digits + 1) : 0.0;
        largest = std::max(largest, quantum);
    }
    return largest / std::sqrt(12.0);
}

Result<OwnRun> run_own_filter(const Scene& scene, const PeerModel& model, const std::vector<VectorXd>& z, int last_step,
                              double model_error_sigma_m, std::size_t threads, const Progress& progress) {
    const auto begin = std::chrono::steady_clock::now();
    OwnModel own(scene, model, threads);
    TERES_TRY_ASSIGN(BoundaryEstimator estimator, BoundaryEstimator::make(own, own_options(model_error_sigma_m)));
    OwnRun out;
    out.refused = own.refused();
    for (std::size_t i = 0; i < own.num_parameters(); ++i) out.names.emplace_back(own.parameter(i).name);
    const Recording& recording = scene.recording;
    const double dt = model.run().dt_s;
    const std::size_t markers = own.kept().size();
    std::vector<std::int32_t> id;
    for (const auto j : own.kept()) id.push_back(static_cast<std::int32_t>(j));
    std::vector<double> x(markers), y(markers), depth(markers), sigma(markers);
    std::vector<std::pair<VectorXd, VectorXd>> rows;
    std::vector<double> nis;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto frame = [&](int step, const VectorXd* row) {
        for (std::size_t m = 0; m < markers; ++m) {
            const auto at = 3 * Index(own.kept()[m]);
            x[m] = row ? (*row)(at) : nan;
            y[m] = row ? (*row)(at + 1) : nan;
            depth[m] = row ? (*row)(at + 2) : nan;
            sigma[m] = row ? std::max(rounding_sigma(scene, own.kept()[m], *row), 1e-9) : 0.0;
        }
        ForwardInputs inputs;
        inputs.time_s = step * dt;
        return estimator.step({static_cast<std::int64_t>(std::llround(1e6 * step * dt)), id, x, y, depth, sigma},
                              inputs);
    };
    if (model.run().integrator != Integrator::kStatic) frame(0, nullptr);  // at rest
    for (std::size_t row = 0; row < z.size(); ++row) {
        const int step = recording.first_record_step + static_cast<int>(row) * recording.record_every_steps;
        if (step == 0) continue;
        if (step > last_step) break;
        frame(step, &z[row]);
        out.step.push_back(step);
        nis.push_back(estimator.nis() / std::max(1, static_cast<int>(estimator.degrees_of_freedom())));
        rows.emplace_back(estimator.theta(), estimator.covariance().diagonal().cwiseSqrt());
        if (progress) progress(step, last_step);
    }
    const auto count = Index(rows.size()), p = Index(own.num_parameters());
    out.theta.resize(count, p);
    out.sigma = out.mean = out.stdev = out.theta;
    for (Index row = 0; row < count; ++row) {
        out.theta.row(row) = rows[std::size_t(row)].first;
        out.sigma.row(row) = rows[std::size_t(row)].second;
        for (Index i = 0; i < p; ++i) {
            out.mean(row, i) = estimator.parameters().to_physical(i, out.theta(row, i));
            out.stdev(row, i) = estimator.parameters().physical_stdev(i, out.theta(row, i), out.sigma(row, i));
        }
    }
    if (!nis.empty()) {
        const auto half = nis.begin() + static_cast<std::ptrdiff_t>(nis.size() / 2);
        const auto middle = half + (nis.end() - half) / 2;
        std::nth_element(half, middle, nis.end());
        out.closing_nis = *middle;
    }
    out.counters = estimator.counters();
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return out;
}

}  // namespace teres::peer
