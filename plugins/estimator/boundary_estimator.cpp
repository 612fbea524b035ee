#include "plugins/estimator/boundary_estimator.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace teres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
// After frames that did not converge the sigma points come closer, down to this share of the set spread.
constexpr double kLeastSpread = 1.0 / 64.0;
constexpr double kDetachedShare = 1e-3;  // estimate of a released ligament, of the threshold of attachment

std::span<double> span_of(MatrixXd& m) {
    return {m.data(), static_cast<std::size_t>(m.size())};
}
std::span<double> span_of(VectorXd& v) {
    return {v.data(), static_cast<std::size_t>(v.size())};
}

Result<ParameterMap> make_map(const ForwardModel& model, Transform transform) {
    std::vector<ParameterSpec> specs;
    for (std::size_t i = 0; i < model.num_parameters(); ++i) {
        const ForwardParameter p = model.parameter(i);
        specs.push_back({p.name, transform, p.prior_median, p.prior_log_stdev, p.prior_stdev, p.lower, p.upper, 0.0});
        // A parameter that may be zero or negative has no logarithm.
        if (transform == Transform::kLog && !(p.prior_median > 0.0 && p.lower >= 0.0))
            specs.back().transform = Transform::kProject;
    }
    return ParameterMap::make(std::move(specs));
}

}  // namespace

Result<BoundaryEstimator> BoundaryEstimator::make(ForwardModel& model, const BoundaryEstimatorOptions& options) {
    if (model.num_markers() == 0) return invalid_input("the model has no markers to observe");
    TERES_TRY_ASSIGN(ParameterMap map, make_map(model, options.transform));
    TERES_TRY_ASSIGN(AttachmentMap attachment, AttachmentMap::make(model, map));
    return BoundaryEstimator(model, options, std::move(map), std::move(attachment));
}

BoundaryEstimator::BoundaryEstimator(ForwardModel& model, const BoundaryEstimatorOptions& options, ParameterMap map,
                                     AttachmentMap attachment)
    : model_(&model),
      options_(options),
      map_(std::move(map)),
      attachment_(std::move(attachment)),
      walk_(options.walk, map_.prior_stdev()),
      monitor_(options.monitor),
      spread_(options.sigma_spread) {
    const auto rows = static_cast<Index>(3 * model.num_markers());
    state_.resize(static_cast<Index>(model.num_state()));
    model.rest_state(span_of(state_));
    rest_markers_.resize(rows);
    model.observe(span_of(state_), span_of(rest_markers_), 1);
    const auto make_filter = options.reduced_order ? make_reduced_order_lane_filter : make_parameter_lane_filter;
    filter_ = make_filter(state_, map_.prior_mean(), map_.prior_stdev(), options.sigma_points);

    noise_ = VectorXd::Ones(rows);
    z_ = residual_ = VectorXd::Constant(rows, kNaN);
    sigma_ = VectorXd::Zero(rows / 3);
    present_.assign(static_cast<std::size_t>(rows / 3), 0);
    lost_.assign(present_.size(), 0);
    used_.assign(static_cast<std::size_t>(rows), 0);
    Z_.resize(rows, filter_->num_lanes());
    theta_ = map_.prior_mean();
    covariance_ = predicted_covariance_ = map_.prior_covariance();
    gate_.use.assign(present_.size(), MarkerUse::kMissing);
    gate_.sigma.assign(present_.size(), 0.0);
}

void BoundaryEstimator::read(const MarkerFrame& frame) {
    z_.setConstant(kNaN);
    std::fill(present_.begin(), present_.end(), std::uint8_t{0});
    std::vector<std::uint8_t> seen(present_.size(), 0);
    for (std::size_t i = 0; i < frame.id.size(); ++i) {
        std::size_t j = 0;
        while (j < present_.size() && model_->marker_id(j) != frame.id[i]) ++j;
        if (j == present_.size() || seen[j] != 0) {
            ++counters_.markers_unknown;
            continue;
        }
        seen[j] = 1;
        const Eigen::Vector3d p(frame.x_m[i], frame.y_m[i], frame.z_m[i]);
        if (!p.allFinite() || lost_[j] != 0) continue;
        const double sigma = frame.sigma_m[i];
        z_.segment<3>(static_cast<Index>(3 * j)) = p;
        sigma_(static_cast<Index>(j)) = std::isfinite(sigma) && sigma > 0.0 ? sigma : options_.default_marker_sigma_m;
        present_[j] = 1;
    }
}

// All sigma points, one call; once more from where they stand if some did not converge.
bool BoundaryEstimator::advance_lanes(ForwardInputs loads) {
    filter_->draw(spread_, lanes_, points_);
    theta_lanes_ = map_.to_physical(points_);
    const auto lanes = static_cast<std::size_t>(lanes_.cols());
    // A dynamic model is at the time of its first frame already.
    if (is_quasi_static() || loads.dt_s > 0.0) {
        report_ = model_->advance(loads, span_of(theta_lanes_), span_of(lanes_), lanes);
        if (report_.lanes_converged < report_.lanes && is_quasi_static() && lanes_.allFinite())
            report_ = model_->advance(loads, span_of(theta_lanes_), span_of(lanes_), lanes);
        counters_.lanes_not_converged += report_.lanes - report_.lanes_converged;
    } else {
        report_ = {static_cast<std::int32_t>(lanes), static_cast<std::int32_t>(lanes), 0, 0, 0.0};
    }
    const bool solved = converged() || report_.relative_residual <= options_.accepted_residual;
    if (!solved || !lanes_.allFinite()) return false;
    model_->observe(span_of(lanes_), span_of(Z_), lanes);
    return Z_.allFinite();
}

void BoundaryEstimator::advance_mean(ForwardInputs loads, const VectorXd& start) {
    MatrixXd x = is_quasi_static() ? VectorXd(lanes_.rowwise().mean()) : start;
    MatrixXd theta = map_.to_physical(filter_->theta());
    if (is_quasi_static() || loads.dt_s > 0.0) {
        const ForwardReport mean = model_->advance(loads, span_of(theta), span_of(x), 1);
        report_.lanes += mean.lanes;
        report_.lanes_converged += mean.lanes_converged;
        report_.relative_residual = std::max(report_.relative_residual, mean.relative_residual);
        counters_.lanes_not_converged += mean.lanes - mean.lanes_converged;
    }
    if (x.allFinite()) filter_->set_state(x);
}

VectorXd BoundaryEstimator::noise_variance(double model_share) const {
    VectorXd variance(z_.size());
    const VectorXd predicted = Z_.rowwise().mean();
    for (Index j = 0; j < sigma_.size(); ++j) {
        const double displacement = (predicted - rest_markers_).segment<3>(3 * j).norm();
        const double model_error = options_.relative_model_error * displacement;
        variance.segment<3>(3 * j).setConstant(
            sigma_(j) * sigma_(j) +
            model_share * (model_error * model_error + options_.model_error_sigma_m * options_.model_error_sigma_m));
        if (!(variance(3 * j) > 0.0)) variance.segment<3>(3 * j).setConstant(1e-18);
    }
    return variance;
}

FrameOutcome BoundaryEstimator::step(const MarkerFrame& frame, ForwardInputs loads) noexcept {
    if (started_ && frame.stamp_us <= stamp_us_) {
        ++counters_.frames_refused;
        return FrameOutcome::kRefused;
    }
    const double dt_s = started_ ? 1e-6 * static_cast<double>(frame.stamp_us - stamp_us_) : 0.0;
    loads.dt_s = started_ ? 1e-6 * static_cast<double>(frame.stamp_us - advanced_us_) : 0.0;
    if (!started_) advanced_us_ = frame.stamp_us;
    started_ = true;
    stamp_us_ = frame.stamp_us;
    ++counters_.frames;
    read(frame);

    // P- = D P D + Q
    const ParameterWalk::Change change = walk_.over(dt_s, covariance_.diagonal(), inconsistent_);
    filter_->widen(change.factor, change.noise_variance);
    counters_.reinflations += inconsistent_;
    inconsistent_ = false;
    predicted_covariance_ = covariance_ = filter_->covariance();
    nis_ = 0.0;
    degrees_of_freedom_ = 0;
    residual_.setConstant(kNaN);
    std::fill(gate_.use.begin(), gate_.use.end(), MarkerUse::kMissing);

    if (!advance_lanes(loads)) {
        spread_ = std::max(0.5 * spread_, kLeastSpread * options_.sigma_spread);
        ++counters_.frames_not_solved;
        std::fill(used_.begin(), used_.end(), std::uint8_t{0});
        record(loads, change);
        return FrameOutcome::kNotSolved;
    }
    spread_ = std::min(2.0 * spread_, options_.sigma_spread);
    advanced_us_ = frame.stamp_us;

    const VectorXd start = filter_->needs_mean_step() ? VectorXd(filter_->state()) : VectorXd();
    filter_->predict(lanes_);
    const Innovation innovation = filter_->innovation(z_, Z_);
    noise_ = noise_variance(1.0);
    gate_ = gate_markers(innovation, noise_, present_, options_.gate);
    counters_.markers_gated += gate_.num_gated;
    for (std::size_t i = 0; i < used_.size(); ++i) used_[i] = gate_.use[i / 3] == MarkerUse::kUsed;
    residual_ = innovation.residual;

    const double r = options_.model_error_correlation_s > 0.0 && dt_s > 0.0
                         ? std::exp(-dt_s / options_.model_error_correlation_s)
                         : 0.0;
    const Rows rows = with_surface(frame.surface, innovation, (1.0 + r) / (1.0 - r));
    nis_ = ensemble_correction(rows.innovation, rows.noise, rows.used).nis;
    noise_ = rows.noise_in_time.head(z_.size());
    const Correction correction = filter_->correct(rows.innovation, rows.noise_in_time, rows.used);
    degrees_of_freedom_ = static_cast<std::int32_t>(correction.num_used);
    filter_->shift_parameters(map_.bring_mean_inside(filter_->theta()));
    if (filter_->needs_mean_step()) advance_mean(loads, start);
    inconsistent_ = monitor_.add(nis_, correction.num_used);

    theta_ = filter_->theta();
    covariance_ = filter_->covariance();
    state_ = filter_->state();
    record(loads, change);
    return correction.num_used > 0 ? FrameOutcome::kCorrected : FrameOutcome::kPredicted;
}

// The markers' rows, below them those of the surface.
BoundaryEstimator::Rows BoundaryEstimator::with_surface(const SurfaceFrame& frame, const Innovation& markers,
                                                        double model_share) {
    Rows rows{markers, noise_, noise_variance(model_share), used_};
    if (!surface_ || frame.x_m.empty()) return rows;
    surface_->look(frame, lanes_);
    const Innovation surface = filter_->innovation(surface_->z(), surface_->Z());
    const std::vector<std::uint8_t> good = surface_->gate(surface);
    const auto append = [](auto& to, const auto& below) {
        const Index above = to.rows();
        to.conservativeResize(above + below.rows(), Eigen::NoChange);
        to.bottomRows(below.rows()) = below;
    };
    append(rows.innovation.residual, surface.residual);
    append(rows.innovation.deviations, surface.deviations);
    append(rows.noise, surface_->variance(1.0));
    append(rows.noise_in_time, surface_->variance(model_share));
    rows.used.insert(rows.used.end(), good.begin(), good.end());
    return rows;
}

void BoundaryEstimator::follow_cut(std::span<const std::int32_t> released, std::span<const std::int32_t> lost_markers) {
    for (const auto p : released) {
        const ForwardParameter of = model_->parameter(static_cast<std::size_t>(p));
        const double nothing = std::max(of.lower, kDetachedShare * of.attachment_threshold);
        filter_->release_parameter(p, map_.to_filter(p, nothing), map_.prior_stdev()(p));
    }
    for (const auto j : lost_markers) lost_[static_cast<std::size_t>(j)] = 1;
    inconsistent_ = true;
    theta_ = filter_->theta();
    covariance_ = filter_->covariance();
}

void BoundaryEstimator::record(const ForwardInputs& loads, const ParameterWalk::Change& change) {
    if (!keeps_recording_) return;
    recording_.push_back({stamp_us_,
                          {loads.region_force_n.begin(), loads.region_force_n.end()},
                          {loads.tool_position_m.begin(), loads.tool_position_m.end()},
                          change,
                          z_,
                          noise_,
                          used_,
                          {theta_, covariance_, predicted_covariance_}});
}

VectorXd BoundaryEstimator::observability() const {
    return (1.0 - covariance_.diagonal().array() / map_.prior_stdev().array().square()).max(0.0).min(1.0);
}

double BoundaryEstimator::stated_stdev(Index i, double filter_variance) const {
    if (!(model_->parameter(static_cast<std::size_t>(i)).attachment_threshold > 0.0)) return std::sqrt(filter_variance);
    const double prior = map_.prior_stdev()(i), unresolved = options_.unresolved_share * prior;
    const double observed = std::max(0.0, 1.0 - filter_variance / (prior * prior));
    return std::sqrt(filter_variance + unresolved * unresolved * observed);
}

void BoundaryEstimator::attachment_probabilities(std::vector<double>& out) const {
    attachment_.probabilities(theta_, covariance_.diagonal().cwiseSqrt(), out);
}

}  // namespace teres
