#include "plugins/diagnosis/problem.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "plugins/diagnosis/share_work.h"

namespace teres {

double mean_square(const Recording& r, const Eigen::VectorXd& simulated, const std::vector<Eigen::Index>& rows) {
    double sum = 0.0;
    for (const Eigen::Index row : rows) sum += std::pow(r.observed(row) - simulated(row), 2);
    return rows.empty() ? 0.0 : sum / static_cast<double>(rows.size());
}

Simulator::Progress stage(const DiagnosisOptions& options, const char* name) {
    return [&options, name](double part) { return !options.progress || options.progress(name, part); };
}

double white_variance_m2(const Recording& recording, const Eigen::VectorXd& motion, Eigen::Index row,
                         const Calibration& calibration) {
    const auto channels = static_cast<Eigen::Index>(3 * recording.num_markers);
    const Eigen::Index first = row - row % 3;
    const double displacement = (motion.segment<3>(first) - motion.segment<3>(first % channels)).norm();
    return std::pow(recording.noise_m, 2) + std::pow(calibration.white_floor_m, 2) +
           std::pow(calibration.white_share * displacement, 2);
}

Whitener whitener_for(const Recording& recording, const Discrepancy& discrepancy, const Eigen::VectorXd& motion,
                      const Calibration& calibration) {
    Eigen::VectorXd sigma(static_cast<Eigen::Index>(recording.fit_rows.size()));
    for (Eigen::Index k = 0; k < sigma.size(); ++k) {
        const Eigen::Index row = recording.fit_rows[static_cast<std::size_t>(k)];
        const auto frame = static_cast<Eigen::Index>(recording.frame_of(row));
        sigma(k) = std::sqrt(white_variance_m2(recording, motion, row, calibration) +
                             std::pow(discrepancy.remainder_m(frame), 2));
    }
    return tempered_whitener(recording.fit_rows, sigma, discrepancy.columns, calibration);
}

Whitener tempered_whitener(const std::vector<Eigen::Index>& rows, const Eigen::VectorXd& sigma,
                           const Eigen::MatrixXd& columns, const Calibration& calibration) {
    const double counted = std::min(1.0, calibration.nu / static_cast<double>(sigma.size()));
    return Whitener(rows, sigma, std::sqrt(counted) * columns);
}

void side_by_side(Problem& problem, std::size_t count, const std::function<void(Problem&, std::size_t)>& work) {
    // A single piece of work may be shared frame by frame; of several each model does its own.
    if (problem.beside == nullptr || count < 2) {
        for (std::size_t k = 0; k < count; ++k) work(problem, k);
        return;
    }
    const Sharing apart(problem.simulator.mechanics(), false);
    Problem* const other = std::exchange(problem.beside, nullptr);  // taken: work within this has one thread
    share_work(true, count, [&](std::size_t who, std::size_t k) { work(who == 0 ? problem : *other, k); });
    problem.beside = other;
}

Fit nominal_fit(Problem& problem, const Assumption& start) {
    Simulator& simulator = problem.simulator;
    Eigen::VectorXd motion;
    simulator.simulate(start, motion);
    const auto reweigh = [&](const Eigen::VectorXd& about) {
        problem.whitener = whitener_for(problem.recording, problem.discrepancy, about, problem.options.calibration);
    };
    reweigh(motion);
    // Without ligaments nothing is to be fitted.
    Fit fit = start.theta.empty() ? problem.fit_on(start, 0) : problem.fit(start, 8, true);
    if (!fit.usable) return fit;
    const double inside = mean_square(problem.recording, fit.trajectory, problem.recording.fit_rows);
    const double outside = mean_square(problem.recording, fit.trajectory, problem.recording.held_rows);
    if (problem.recording.held_markers.empty() &&
        outside > kLateRatio * std::max(inside, std::pow(problem.recording.noise_m, 2) +
                                                    std::pow(problem.options.calibration.white_floor_m, 2)))
        problem.recording.hold_out_markers(fit.trajectory);
    reweigh(fit.trajectory);
    problem.complete(fit);  // the frames between follow from a whole trajectory nearby
    // Without weights: causes are compared with the best that the nominal model can do.
    fit = problem.fit_on(fit.at, 10);
    problem.complete(fit);
    problem.look_ahead(fit);
    problem.floor = error_floor(problem.whitener, problem.discrepancy, fit.J, problem.recording.noise_m,
                                simulator.mechanics().dynamic(), problem.options.calibration);
    if (simulator.mechanics().dynamic()) return fit;  // there the model's error has a course of its own
    problem.span = std::make_shared<const MotionSpan>(fit.trajectory, 3 * problem.recording.num_markers,
                                                      problem.recording.fit_rows);
    problem.floor = split_floor(problem.floor, problem.span->degrees() / static_cast<double>(problem.whitener.size()),
                                problem.options.calibration);
    problem.look_beside(fit);
    return fit;
}

}  // namespace teres
