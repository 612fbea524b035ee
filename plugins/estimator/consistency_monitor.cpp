#include "plugins/estimator/consistency_monitor.h"

#include <algorithm>
#include <numeric>

#include "core/check.h"
#include "plugins/estimator/probability.h"

namespace teres {

ConsistencyMonitor::ConsistencyMonitor(Options options) : options_(options) {
    TERES_CHECK(options.window >= 1 && options.baseline_frames >= 1);
    TERES_CHECK(options.probability > 0.0 && options.probability < 1.0);
    nis_.reserve(static_cast<std::size_t>(options.window));
    dof_.reserve(static_cast<std::size_t>(options.window));
}

bool ConsistencyMonitor::add(double nis, Eigen::Index degrees_of_freedom) {
    if (degrees_of_freedom <= 0) return false;
    const double dof = static_cast<double>(degrees_of_freedom);
    if (nis_.size() == static_cast<std::size_t>(options_.window)) {
        nis_.erase(nis_.begin());
        dof_.erase(dof_.begin());
    }
    nis_.push_back(nis);
    dof_.push_back(dof);

    const double sum = std::accumulate(nis_.begin(), nis_.end(), 0.0);
    const double sum_dof = std::accumulate(dof_.begin(), dof_.end(), 0.0);
    const double level = std::max(baseline_, options_.baseline_floor);
    const double bound = level * std::max(chi_square_quantile(options_.probability, sum_dof), options_.ratio * sum_dof);
    const bool inconsistent = sum > bound;

    // Running mean first, exponential later; a jump counts at most `ratio` times the level, so that it is not
    // absorbed at once.
    num_frames_ = std::min(num_frames_ + 1.0, static_cast<double>(options_.baseline_frames));
    const double news = std::min(nis / dof, options_.ratio * level);
    baseline_ += (news - baseline_) / (num_frames_ + 1.0);
    if (inconsistent) {
        nis_.clear();
        dof_.clear();
    }
    return inconsistent;
}

}  // namespace teres
