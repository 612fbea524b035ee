// A recording of a body whose motion is known as a diagnosis' problem: white noise, no error of the model.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "plugins/diagnosis/problem.h"

namespace teres::test {

struct PosedProblem {
    /// `body`, `camera` (or null) and `effects` must outlive it; sets the nominal fit of a body without unknowns.
    void pose(TrajectoryModel& body, const ObservationModel* camera, const EffectTable& effects,
              const std::vector<double>& observed, double noise_m) {
        recording_.emplace(*make_recording({"toy", &body, camera, observed, noise_m, 1}));
        simulator_.emplace(body, camera, effects);
        Discrepancy exact;
        exact.columns.resize(recording_->observed.size(), 0);
        problem_.emplace(Problem{
            *simulator_, *recording_, options_, std::move(exact),
            Whitener(recording_->fit_rows, Eigen::VectorXd::Constant(static_cast<Eigen::Index>(count()), noise_m),
                     Eigen::MatrixXd(recording_->observed.size(), 0))});
        nominal_ = problem_->fit({}, 0);
    }
    double count() const { return static_cast<double>(recording_->fit_rows.size()); }

    const DiagnosisOptions options_;
    std::optional<Recording> recording_;
    std::optional<Simulator> simulator_;
    std::optional<Problem> problem_;
    Fit nominal_;
};

}  // namespace teres::test
