// Nominal parameters and the parameters of switched-on effects fitted together to the used part of a recording:
//
//     minimise  |W (y - h(u))|^2 + |u|^2,     u = (coordinates - prior mean) / prior standard deviation
//
// by Levenberg-Marquardt with the first-order responses of the simulator as Jacobian. W: Whitener. What a step asks for
// is settled (FitSpace::assumption): a place on the surface stays there, and only moves T du along it count.
#pragma once

#include <Eigen/Dense>
#include <functional>

#include "plugins/diagnosis/fit_space.h"
#include "plugins/diagnosis/simulator.h"
#include "plugins/diagnosis/whitener.h"
#include "plugins/diagnosis/work_limit.h"

namespace teres {

struct FitOptions {
    int max_iterations = 8;
    double tolerance = 0.01;     ///< of the relative decrease of the cost
    std::size_t num_frames = 0;  ///< only so many from the first; 0: all
    bool growing = false;        ///< the beginning of the recording first: a phase must not be off by half a period
    /// Whether a fit is of no use that will come to `misfit` and leaves `residual` (whitened) now: it is given up where
    /// its last steps lead to no better. Empty: none is.
    std::function<bool(const Eigen::VectorXd& residual, double misfit)> hopeless{};
    const WorkLimit* limit = nullptr;  ///< once reached, a few iterations have to do
    bool robust = false;  ///< markers far off the rest lose weight (Huber), so that a slipped one does not bend the fit
};

struct Fit {
    Assumption at;
    Eigen::VectorXd u;           ///< scaled coordinates
    Eigen::VectorXd trajectory;  ///< h(u), full
    Eigen::VectorXd residual;    ///< W (y - h)
    Eigen::MatrixXd J;           ///< W dh/du
    Eigen::MatrixXd T;           ///< how far the settled coordinates follow: 1, along a surface its projector
    double cost = 0.0;           ///< |residual|^2 + |u|^2 over nominal parameters + |u|^2 over effect parameters
    double misfit = 0.0;         ///< |residual|^2
    double beside = 0.0;  ///< of misfit, what lies beside the span of the motion (motion_span.h), where told apart
    double later = 0.0;   ///< what it leaves beyond the fitted frames (Outlook), 0: nothing is known of them
    bool usable = false;  ///< the simulation converged

    /// By which hypotheses are compared.
    double compared_cost() const { return cost + later; }

    /// Whether derivatives tell next to nothing of a scaled coordinate (an instant between two frames).
    bool says_nothing_of(Eigen::Index coordinate) const;
    /// Standard deviations of the scaled coordinates when the data count `tempering` times.
    Eigen::VectorXd stdev(double tempering) const;
};

/// `start`: effects and their values; nominal parameters too. `observed`: full trajectory, NaN where lost.
Fit fit_jointly(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed,
                const Assumption& start, const FitOptions& options);

/// The fit with every frame simulated; the simulator's base is then `fit.at`.
void complete(Simulator& simulator, const Whitener& whitener, const Eigen::VectorXd& observed, Fit& fit);

}  // namespace teres
