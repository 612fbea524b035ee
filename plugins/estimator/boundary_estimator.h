// From one frame of markers to the boundary conditions that explain it. Per frame (step()):
//
//     widen      parameters may have moved since the last frame          parameter_walk.h
//     advance    all sigma points through the forward model, one call    core/extensions/forward_model.h
//     gate       markers that contradict the prediction                  marker_gate.h
//     look       points of the organ's surface, if wanted                 surface_observation.h
//     correct    parameters and state                                    ro_ukf.h or ukf.h
//     judge      does the innovation fit the filter's own uncertainty    consistency_monitor.h
//
// Noise of a marker per axis: sigma^2 + (relative_model_error |displacement|)^2 + model_error_sigma_m^2. The
// last two are the model's error: it is larger than the sensor's and does not average out, so a filter that
// leaves it out becomes too sure. It is not white either: with correlation time T, frames dt apart are worth
//     (1 - r)/(1 + r), r = exp(-dt/T)     independent ones (mean of an AR(1) series),
// so its variance counts (1 + r)/(1 - r) times in the correction, but once in gate and NIS.
//
// A ligament holds with a part of a group's nodes; the group has one stiffness. Seen from the markers a half attached
// group and a softer whole one are alike, so its stiffness is known less well than the filter thinks: with s0 the
// prior's deviation and u = unresolved_share,
//     stated variance = s^2 + (u s0)^2 (1 - s^2/s0^2)           never above the prior's.
// Only what is stated to others; the filter's own covariance stays as it is.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/extensions/forward_model.h"
#include "plugins/estimator/attachment.h"
#include "plugins/estimator/consistency_monitor.h"
#include "plugins/estimator/iterated_smoother.h"
#include "plugins/estimator/lane_filter.h"
#include "plugins/estimator/marker_gate.h"
#include "plugins/estimator/parameter_map.h"
#include "plugins/estimator/parameter_walk.h"
#include "plugins/estimator/surface_observation.h"

namespace teres {

struct BoundaryEstimatorOptions {
    bool reduced_order = true;  ///< false: parameters only
    SigmaPointKind sigma_points = SigmaPointKind::kSimplex;
    double sigma_spread = 1.0;
    Transform transform = Transform::kLog;
    ParameterWalk::Options walk{};
    GateOptions gate{};
    ConsistencyMonitor::Options monitor{};
    double default_marker_sigma_m = 0.0005;
    double relative_model_error = 0.05;
    double model_error_sigma_m = 0.0003;
    double model_error_correlation_s = 0.0;
    double unresolved_share = 0.0;
    double accepted_residual = 1e-2;
};

/// Markers of one frame; the spans are equally long. A coordinate that is not finite: marker lost.
struct MarkerFrame {
    std::int64_t stamp_us = 0;
    std::span<const std::int32_t> id;
    std::span<const double> x_m, y_m, z_m;
    std::span<const double> sigma_m;  ///< 0 or not finite: not stated
    SurfaceFrame surface{};           ///< used after observe_surface()
};

enum class FrameOutcome {
    kCorrected,
    kPredicted,  ///< no usable marker: prediction only
    kNotSolved,  ///< the model did not converge: nothing but the uncertainty changed
    kRefused,    ///< not newer than the last frame: nothing changed
};

struct EstimatorCounters {
    std::int64_t frames = 0;
    std::int64_t frames_refused = 0;
    std::int64_t frames_not_solved = 0;
    std::int64_t lanes_not_converged = 0;
    std::int64_t markers_unknown = 0;  ///< ids that the model does not have, or twice in a frame
    std::int64_t markers_gated = 0;
    std::int64_t reinflations = 0;
};

class BoundaryEstimator {
  public:
    /// `model` must outlive the estimator. Errors (kInvalidInput): priors or attachment nodes that make no
    /// sense; no markers.
    static Result<BoundaryEstimator> make(ForwardModel& model, const BoundaryEstimatorOptions& options);

    /// [loop] loads: at the time of the frame; its dt_s is filled in here.
    FrameOutcome step(const MarkerFrame& frame, ForwardInputs loads) noexcept;

    /// [loop] The body was cut: the model no longer reacts to these parameters (their estimate is: not attached), these
    /// markers (indices of the model) went with their tissue. The other parameters become less sure once, by the
    /// re-inflation of an inconsistent frame: a cut may change more than was said.
    void follow_cut(std::span<const std::int32_t> released, std::span<const std::int32_t> lost_markers);

    /// [setup] Surface points count from now on. The offline smoother does not know them: not with keep_recording().
    void observe_surface(SurfaceObservation surface) { surface_ = std::move(surface); }

    // Of the last frame that was not refused.
    std::int64_t stamp_us() const { return stamp_us_; }
    bool started() const { return started_; }
    const ParameterMap& parameters() const { return map_; }
    const Eigen::VectorXd& theta() const { return theta_; }            ///< filter coordinates
    const Eigen::MatrixXd& covariance() const { return covariance_; }  ///< filter coordinates
    const Eigen::MatrixXd& predicted_covariance() const { return predicted_covariance_; }
    Eigen::VectorXd observability() const;  ///< 1 - variance / prior variance, in [0, 1]
    /// Standard deviation of parameter i in filter coordinates, with what a group does not resolve.
    double stated_stdev(Eigen::Index i, double filter_variance) const;
    const AttachmentMap& attachment() const { return attachment_; }
    const std::vector<std::int32_t>& attachment_nodes() const { return attachment_.node_ids(); }
    void attachment_probabilities(std::vector<double>& out) const;
    const Eigen::VectorXd& state() const { return state_; }  ///< corrected mechanical state
    const ForwardReport& report() const { return report_; }
    bool converged() const { return report_.lanes_converged == report_.lanes; }
    double relative_residual() const { return report_.relative_residual; }
    const Eigen::VectorXd& residual() const {
        return residual_;
    }  ///< observed minus predicted, 3 per marker; NaN: missing
    const GateResult& gate() const { return gate_; }
    double nis() const { return nis_; }
    std::int32_t degrees_of_freedom() const { return degrees_of_freedom_; }
    const EstimatorCounters& counters() const { return counters_; }

    /// [setup] Keeps what an offline smoother needs of every frame (unbounded memory: not for the service).
    void keep_recording(bool keep) { keeps_recording_ = keep; }
    const std::vector<RecordedFrame>& recording() const { return recording_; }

  private:
    BoundaryEstimator(ForwardModel& model, const BoundaryEstimatorOptions& options, ParameterMap map,
                      AttachmentMap attachment);
    void read(const MarkerFrame& frame);
    struct Rows {
        Innovation innovation;
        Eigen::VectorXd noise, noise_in_time;  // the latter with the correlation of the model's error
        std::vector<std::uint8_t> used;
    };
    Rows with_surface(const SurfaceFrame& frame, const Innovation& markers, double model_share);
    bool advance_lanes(ForwardInputs loads);
    void record(const ForwardInputs& loads, const ParameterWalk::Change& change);
    void advance_mean(ForwardInputs loads, const Eigen::VectorXd& start);
    /// model_share: how many times the variance of the model's error counts.
    Eigen::VectorXd noise_variance(double model_share) const;
    bool is_quasi_static() const { return model_->num_state() == 3 * model_->num_nodes(); }

    ForwardModel* model_;
    BoundaryEstimatorOptions options_;
    ParameterMap map_;
    AttachmentMap attachment_;
    std::unique_ptr<LaneFilter> filter_;
    ParameterWalk walk_;
    ConsistencyMonitor monitor_;

    bool started_ = false;
    std::int64_t stamp_us_ = 0;
    std::int64_t advanced_us_ = 0;  // of the mechanical state
    bool inconsistent_ = false;
    double spread_ = 1.0;

    Eigen::VectorXd rest_markers_, z_, noise_;  // 3 per marker
    Eigen::VectorXd sigma_;                     // per marker
    std::vector<std::uint8_t> present_, used_;  // per marker; per row
    std::vector<std::uint8_t> lost_;            // per marker: its tissue is cut away
    Eigen::MatrixXd lanes_, points_, theta_lanes_, Z_;
    Eigen::VectorXd theta_, state_, residual_;
    Eigen::MatrixXd covariance_, predicted_covariance_;
    ForwardReport report_{};
    std::optional<SurfaceObservation> surface_;
    GateResult gate_;
    double nis_ = 0.0;
    std::int32_t degrees_of_freedom_ = 0;
    EstimatorCounters counters_;
    bool keeps_recording_ = false;
    std::vector<RecordedFrame> recording_;
};

}  // namespace teres
