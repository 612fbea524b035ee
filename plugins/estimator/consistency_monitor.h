// Tells when the innovation no longer fits what the filter believes (a ligament has let go): the filter
// should then open up.
//
// For a consistent filter the NIS of a frame is chi2 with its degrees of freedom. Sum over a short window
// against
//
//     sum NIS > baseline * max(chi2(probability, sum dof), ratio * sum dof)
//
// where the baseline is the long-run mean of NIS / dof: a model with a constant error, or noise that was
// stated too large, has another level than 1, and only a change of level is news.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace teres {

class ConsistencyMonitor {
  public:
    struct Options {
        int window = 3;                ///< frames, >= 1
        double probability = 0.9999;   ///< of chi2 for the window, in (0, 1)
        double ratio = 3.0;            ///< >= 1: smallest jump of NIS / dof over its long-run level that counts
        int baseline_frames = 30;      ///< time constant of the long-run level, >= 1
        double baseline_floor = 0.05;  ///< > 0: smallest long-run level
    };
    ConsistencyMonitor() : ConsistencyMonitor(Options{}) {}
    explicit ConsistencyMonitor(Options options);

    /// One corrected frame. True: inconsistent; the window starts anew so that the next answer is about new
    /// frames.
    bool add(double nis, Eigen::Index degrees_of_freedom);
    double baseline() const { return baseline_; }

  private:
    Options options_;
    std::vector<double> nis_, dof_;  // of the window, oldest first
    double baseline_ = 1.0;
    double num_frames_ = 0.0;
};

}  // namespace teres
