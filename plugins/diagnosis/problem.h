// One diagnosis' problem: what its stages share, and its nominal fit.
#pragma once

#include <cmath>
#include <limits>
#include <map>
#include <memory>

#include "plugins/diagnosis/diagnosis.h"
#include "plugins/diagnosis/motion_span.h"
#include "plugins/diagnosis/outlook.h"
#include "plugins/diagnosis/work_limit.h"

namespace teres {

/// Mean square of the frames held out over that of the fitted ones, or over what the model may be off: something
/// happens late, or what was fitted stands for something else.
inline constexpr double kLateRatio = 3.0;

/// Progress of one stage, as the simulator asks for it.
Simulator::Progress stage(const DiagnosisOptions& options, const char* name);

/// Of observed minus simulated at the given entries [m^2]; 0 without any.
double mean_square(const Recording& r, const Eigen::VectorXd& simulated, const std::vector<Eigen::Index>& rows);

/// Variance of one number of a trajectory [m^2]: stated noise and the white part of the model's error, about `motion`.
double white_variance_m2(const Recording& recording, const Eigen::VectorXd& motion, Eigen::Index row,
                         const Calibration& calibration);

/// Stated noise and what the discrepancy columns leave: an absolute part, and a share of each marker's displacement in
/// `motion`.
Whitener whitener_for(const Recording& recording, const Discrepancy& discrepancy, const Eigen::VectorXd& motion,
                      const Calibration& calibration);

/// The same from its parts: coefficients of `columns` are N(0,1) against data that count as nu numbers, not as all.
Whitener tempered_whitener(const std::vector<Eigen::Index>& rows, const Eigen::VectorXd& sigma,
                           const Eigen::MatrixXd& columns, const Calibration& calibration);

/// What a fit must leave less than to be of use.
struct Reach {
    double misfit = std::numeric_limits<double>::infinity();
    double log_above = std::numeric_limits<double>::infinity();  ///< ErrorFloor::log_above
    /// It may leave nothing beside the span of the motion in the end, whatever it leaves there now: an event at
    /// another instant has another course in time. Else what is there goes down with the rest.
    bool any_course = false;
};

/// What makes a body swing as it does, fitted together (swing.h), and what was searched for it.
struct Swing {
    Fit fit;
    std::map<std::size_t, double> search_costs{};  ///< of effects, by entry [nats]
};

struct Problem {
    Simulator& simulator;
    Recording& recording;
    const DiagnosisOptions& options;
    Discrepancy discrepancy;
    Whitener whitener;
    ErrorFloor floor{};
    Outlook* outlook = nullptr;  ///< null: nothing beyond the fitted frames
    const WorkLimit* limit = nullptr;
    std::shared_ptr<const MotionSpan> span{};  ///< of the nominal motion; null: nothing is told apart by it
    std::shared_ptr<const Swing> swing{};      ///< with inertia, once asked for (swing.h)
    Problem* beside = nullptr;  ///< the same with a simulator of its own, for a second thread; null: there is none

    Reach reach{};                                                 ///< of every fit
    double worst_start = std::numeric_limits<double>::infinity();  ///< misfit: a refit that begins beyond is not made

    Fit fit(const Assumption& start, int iterations, bool robust = false) {
        return fit_jointly(simulator, whitener, recording.observed, start,
                           {.max_iterations = iterations,
                            .growing = simulator.mechanics().dynamic(),
                            .hopeless = hopeless_now(),
                            .limit = limit,
                            .robust = robust});
    }
    /// From where a fit of the whole recording ended: its beginning is not fitted before it.
    Fit fit_on(const Assumption& from, int iterations) {
        return fit_jointly(simulator, whitener, recording.observed, from,
                           {.max_iterations = iterations, .hopeless = hopeless_now(), .limit = limit});
    }
    std::function<bool(const Eigen::VectorXd& residual, double misfit)> hopeless_now() const {
        return [this](const Eigen::VectorXd& residual, double misfit) { return hopeless(residual, misfit); };
    }
    /// Whether what leaves `residual` now will be of no use at this misfit.
    bool hopeless(const Eigen::VectorXd& residual, double misfit) const {
        if (misfit >= reach.misfit) return true;
        if (!std::isfinite(reach.log_above)) return false;
        const Left ahead =
            reach.any_course ? Left(misfit) : floor.scaled({residual.squaredNorm(), beside_span(residual)}, misfit);
        return floor.log_above(ahead) >= reach.log_above;
    }
    bool hopeless(const Fit& fit) const { return hopeless(fit.residual, fit.misfit); }
    /// What right causes leave (Calibration::unknown_left); `floor` is what noise and the model's error explain.
    ErrorFloor right_floor() const { return floor.with_model(options.calibration.unknown_left); }
    /// Work that an answer can do without is left out.
    bool out_of_time() const { return limit != nullptr && limit->reached(); }
    /// Whether as much work as was done is left.
    bool time_for_as_much() const { return limit == nullptr || limit->leaves_as_much(); }
    /// Observed minus simulated, 0 where lost [m].
    Eigen::VectorXd residual_of(const Eigen::VectorXd& trajectory) const {
        const Eigen::VectorXd difference = recording.observed - trajectory;
        return difference.array().isFinite().select(difference, 0.0);
    }
    /// Fills what a fit leaves beyond the fitted frames.
    void look_ahead(Fit& fit, bool roughly = false) {
        if (outlook != nullptr && fit.usable)
            fit.later = outlook->later(fit.at, fit.residual.squaredNorm(), recording.fit_rows.size(), roughly);
    }
    /// What of a whitened residual lies beside the span of the motion; 0 where that is not told.
    double beside_span(const Eigen::VectorXd& residual) const { return span != nullptr ? span->beside(residual) : 0.0; }
    /// Of a fit: beside the noise that it assumes.
    void look_beside(Fit& fit) const {
        if (fit.usable)
            fit.beside = floor.beside_noise({0.0, beside_span(fit.residual)}, simulator.noise_factor(fit.at)).beside;
    }
    /// Every frame simulated, exact derivatives: the base of a search.
    void complete(Fit& fit) { teres::complete(simulator, whitener, recording.observed, fit); }
};

/// While it lives, a model shares the work of single calls with its twin, or does not; then the reverse.
class Sharing {
  public:
    Sharing(TrajectoryModel& model, bool on) : model_(model), on_(on) { model_.share_with_twin(on_); }
    ~Sharing() { model_.share_with_twin(!on_); }
    Sharing(const Sharing&) = delete;
    Sharing& operator=(const Sharing&) = delete;

  private:
    TrajectoryModel& model_;
    bool on_;
};

/// While it lives, fits of this problem are given up that do not come within reach, or begin beyond the misfit `start`.
class GivenUpBeyond {
  public:
    GivenUpBeyond(Problem& problem, const Reach& reach, double start = std::numeric_limits<double>::infinity())
        : problem_(problem), reach_(problem.reach), worst_start_(problem.worst_start) {
        problem.reach = reach;
        problem.worst_start = start;
    }
    ~GivenUpBeyond() {
        problem_.reach = reach_;
        problem_.worst_start = worst_start_;
    }
    GivenUpBeyond(const GivenUpBeyond&) = delete;
    GivenUpBeyond& operator=(const GivenUpBeyond&) = delete;

  private:
    Problem& problem_;
    Reach reach_;  // before
    double worst_start_;
};

/// share_work() of a problem and the one beside it.
void side_by_side(Problem& problem, std::size_t count,
                  const std::function<void(Problem& problem, std::size_t k)>& work);

/// Nominal parameters alone; whether the last frames are held out or, if something happens in them, markers. Sets
/// whitener and floor.
Fit nominal_fit(Problem& problem, const Assumption& start);

}  // namespace teres
