#include "plugins/diagnosis/outlook.h"

#include <algorithm>
#include <cmath>

#include "plugins/diagnosis/problem.h"

namespace teres {
namespace {

constexpr double kLost = 1e6;  // cost per number of a model whose trajectory cannot be followed so far

}  // namespace

Result<std::unique_ptr<Outlook>> Outlook::make(const GapRecording& from, const EffectTable& effects,
                                               const Calibration& calibration, bool with_twin) {
    if (from.whole_mechanics == nullptr) return std::unique_ptr<Outlook>();
    const GapRecording whole = whole_of(from);
    TERES_TRY_ASSIGN(Recording recording, make_recording(whole));
    const std::size_t first = from.mechanics->num_frames(), all = recording.num_frames;
    const std::size_t end = first + std::min(first, (all - first) / 2);
    if (end == first) return std::unique_ptr<Outlook>();
    TrajectoryModel* twin = with_twin ? whole.mechanics->twin() : nullptr;
    Simulator simulator(twin != nullptr ? *twin : *whole.mechanics, whole.sensors, effects);
    return std::unique_ptr<Outlook>(new Outlook(std::move(recording), std::move(simulator), first, end, calibration));
}

void Outlook::stand_on(const Assumption& nominal) {
    nominal_ = nominal;
    stands_.reset();
}

// Simulates from where it stands, on first use.
bool Outlook::stands() {
    Eigen::VectorXd motion;
    if (nominal_ && !stands_) stands_ = simulator_.simulate(*nominal_, motion);
    return stands_.value_or(false);
}

double Outlook::later(const Assumption& at, double misfit, std::size_t num_fitted, bool roughly) {
    Eigen::VectorXd motion;
    const Horizon horizon(simulator_, end_);
    const bool followed =
        roughly && stands() ? simulator_.approximate(at, motion) : simulator_.simulate_apart(at, end_, motion);
    const auto channels = static_cast<Eigen::Index>(3 * recording_.num_markers);
    double sum = 0.0;
    std::size_t count = 0;
    for (Eigen::Index row = channels * static_cast<Eigen::Index>(first_);
         row < channels * static_cast<Eigen::Index>(end_); ++row) {
        if (!std::isfinite(recording_.observed(row))) continue;
        ++count;
        if (!followed || !std::isfinite(motion(row))) {
            sum += kLost;
            continue;
        }
        sum += std::min(kLost, std::pow(recording_.observed(row) - motion(row), 2) /
                                   white_variance_m2(recording_, motion, row, calibration_));
    }
    return count == 0 ? 0.0 : 0.5 * (sum * static_cast<double>(num_fitted) / static_cast<double>(count) - misfit);
}

}  // namespace teres
