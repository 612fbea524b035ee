// The whole recording against the whole recording: fixed-interval smoothing with a nonlinear, quasi-static
// model. Offline only.
//
// The filter linearises each frame where it believed the parameters to be at that time; early frames see a
// poor guess. Here the path theta_k is improved until it explains all frames best (maximum a posteriori):
//
//     J = |theta_0 - m|^2_prior + sum |theta_k - theta_{k-1}|^2_Q + sum |z_k - h(theta_k)|^2_R
//
// One pass: every frame is linearised about the path with the path's own covariance P_k = S_k S_k^T,
//
//     z_k = zbar_k + H_k (theta_k - path_k) + v_k,      H_k = sum w_i (Z_i - zbar) I_i^T S_k^-1
//
// a linear Kalman filter and smoother run over all frames from the prior, and the path moves to their result,
// or a part of the way, if J falls (posterior linearisation smoother: Garcia-Fernandez, Svensson, Sarkka,
// IEEE Trans. Automatic Control 62, 2017, with a line search). It starts from the plain smoother's path or
// from the last frame's parameters held constant, whichever has the smaller J.
#pragma once

#include <functional>
#include <vector>

#include "core/extensions/forward_model.h"
#include "plugins/estimator/fixed_interval_smoother.h"
#include "plugins/estimator/parameter_map.h"
#include "plugins/estimator/parameter_walk.h"

namespace teres {

/// What the filter did with one frame, kept for the smoother.
struct RecordedFrame {
    std::int64_t stamp_us = 0;
    std::vector<double> region_force_n, tool_position_m;
    ParameterWalk::Change change;    ///< before this frame
    Eigen::VectorXd z;               ///< 3 per marker
    Eigen::VectorXd noise_variance;  ///< 3 per marker
    std::vector<std::uint8_t> used;  ///< per row
    FilteredFrame filtered;
};

struct SmootherResult {
    std::vector<SmoothedFrame> frames;  ///< one per recorded frame
    std::vector<double> cost;           ///< J of the start and after every pass, never rising
    std::int64_t lanes_not_converged = 0;
};

/// passes >= 0: 0 is the plain smoother, and J is not evaluated. `progress(share)` gets the part done, in [0,
/// 1], and may be empty.
SmootherResult smooth_recording(ForwardModel& model, const ParameterMap& map, const std::vector<RecordedFrame>& frames,
                                int passes, const std::function<void(double)>& progress = {});

}  // namespace teres
