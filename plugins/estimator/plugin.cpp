// Unit `estimator`: TOOL_LOADS, MARKERS, SURFACE_POINTS and CUT in; BOUNDARY_ESTIMATE, LIVER_STATE and INNOVATION out,
// one of each per frame, stamped with the capture time of the frame and nothing else, so that a replay gives the same
// bytes.
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>
#include <utility>

#include "core/case/case_reader.h"
#include "core/extensions/offline_estimate.h"
#include "core/extensions/topology.h"
#include "core/load_book.h"
#include "core/plugin_sdk.h"
#include "plugins/estimator/boundary_estimator.h"
#include "plugins/estimator/settings.h"
#include "teres/boundary_estimate_t.hpp"
#include "teres/cut_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/surface_points_t.hpp"
#include "teres/tool_loads_t.hpp"

namespace teres {
namespace {

constexpr std::size_t kMaxMessageBytes = 1 << 20;
constexpr std::size_t kMaxCuts = 64;

}  // namespace

class EstimatorPlugin final : public Unit, public OfflineEstimate {
  public:
    using Settings = EstimatorSettings;
    Settings settings;

    explicit EstimatorPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override {
        TERES_TRY_ASSIGN(options_, settings.options());
        surface_.reset();
        if (!settings.surface) return {};
        if (settings.keep_recording)
            return invalid_input(
                "estimator.surface and estimator.keep_recording exclude each other: the smoother knows markers only");
        if (settings.case_folder.empty())
            return invalid_input("estimator.surface needs estimator.case (or service.case): no case folder is named");
        CaseReadOptions reading;
        reading.observations = false;
        TERES_TRY_ASSIGN(const Case c, read_case(settings.case_folder, reading));
        SurfaceOptions options = settings.surface_options;
        options.probability = options_.gate.probability;
        options.relative_model_error = options_.relative_model_error;
        options.model_error_sigma_m = options_.model_error_sigma_m;
        surface_.emplace(c.mesh, options);
        return {};
    }

    Status start() override {
        model_ = host_.extension<ForwardModel>();
        if (model_ == nullptr)
            return invalid_input(
                "estimator: no unit before it offers teres.forward_model/1; name [simulation] above "
                "[estimator]");
        auto estimator = BoundaryEstimator::make(*model_, options_);
        if (!estimator) return invalid_input("estimator: " + estimator.error().text);
        estimator_.emplace(std::move(*estimator));
        estimator_->keep_recording(settings.keep_recording);
        if (surface_) estimator_->observe_surface(*surface_);
        surface_points_.clear();
        smoothed_ = {};
        loads_.emplace(*model_);
        topology_ = host_.extension<Topology>();
        queue_.clear();
        cuts_.clear();
        prepare_messages();
        TERES_TRY(host_.subscribe<tool_loads_t>("TOOL_LOADS", kMaxMessageBytes,
                                                [this](const tool_loads_t& m, std::int64_t) { take_loads(m); }));
        TERES_TRY(host_.subscribe<markers_t>("MARKERS", kMaxMessageBytes,
                                             [this](const markers_t& m, std::int64_t) { take_markers(m); }));
        if (surface_)
            TERES_TRY(host_.subscribe<surface_points_t>(
                "SURFACE_POINTS", kMaxMessageBytes,
                [this](const surface_points_t& m, std::int64_t) { take_surface(m); }));
        TERES_TRY(
            host_.subscribe<cut_t>("CUT", kMaxMessageBytes, [this](const cut_t& m, std::int64_t) { take_cut(m); }));
        return {};
    }

    teres_step_outcome step(std::int64_t) noexcept override {
        if (!estimator_) return TERES_STEP_IDLE;
        if (!queue_.empty()) {
            const markers_t frame = std::move(queue_.front());
            queue_.pop_front();
            return work(frame);
        }
        // What came since the last step may still be on its way through another unit (frames that become MARKERS).
        if (std::exchange(arrived_, false)) return TERES_STEP_IDLE;
        // Loads keep coming but no markers: go on as a prediction, at the time of the loads.
        const auto stale_us = static_cast<std::int64_t>(1e6 * settings.stale_after_s);
        if (estimator_->started() && loads_->newest_us() >= estimator_->stamp_us() + stale_us) {
            markers_t none;
            none.header.capture_stamp_us = loads_->newest_us();
            none.header.frame_id = estimate_.header.frame_id;
            none.num_markers = 0;
            return work(none);
        }
        return TERES_STEP_IDLE;
    }

    void stop() override {
        // The model belongs to a unit that may be gone before the next start.
        estimator_.reset();
        loads_.reset();
        model_ = nullptr;
        topology_ = nullptr;
    }

    void* extension(std::string_view id) override {
        return id == OfflineEstimate::kId ? static_cast<OfflineEstimate*>(this) : nullptr;
    }

    // OfflineEstimate
    std::size_t num_parameters() const override { return model_ != nullptr ? model_->num_parameters() : 0; }
    std::size_t num_attachment_nodes() const override { return model_ != nullptr ? model_->num_attachment_nodes() : 0; }
    std::size_t num_frames() const override { return estimator_ ? estimator_->recording().size() : 0; }
    std::int64_t frame_stamp_us(std::size_t frame) const override { return estimator_->recording()[frame].stamp_us; }
    bool smooth(int passes, void (*progress)(void*, double), void* user) noexcept override {
        if (num_frames() == 0) return false;
        const bool quasi_static = model_->num_state() == 3 * model_->num_nodes();
        smoothed_ = smooth_recording(*model_, estimator_->parameters(), estimator_->recording(),
                                     quasi_static ? passes : 0, [&](double part) {
                                         if (progress != nullptr) progress(user, part);
                                     });
        return true;
    }
    void parameters(std::size_t frame, std::span<double> mean, std::span<double> stdev,
                    std::span<double> observability) const override {
        const ParameterMap& map = estimator_->parameters();
        const SmoothedFrame& smoothed = smoothed_.frames[frame];
        for (Eigen::Index i = 0; i < map.size(); ++i) {
            const auto k = static_cast<std::size_t>(i);
            const double variance = smoothed.covariance(i, i), prior = map.prior_stdev()(i);
            mean[k] = map.to_physical(i, smoothed.mean(i));
            stdev[k] = map.physical_stdev(i, smoothed.mean(i), estimator_->stated_stdev(i, variance));
            observability[k] = std::clamp(1.0 - variance / (prior * prior), 0.0, 1.0);
        }
    }
    void attachment(std::size_t frame, std::span<double> probability) const override {
        const SmoothedFrame& smoothed = smoothed_.frames[frame];
        std::vector<double> out;
        estimator_->attachment().probabilities(smoothed.mean, smoothed.covariance.diagonal().cwiseSqrt(), out);
        std::copy(out.begin(), out.end(), probability.begin());
    }

  private:
    void take_loads(const tool_loads_t& message) {
        if (!loads_) return;
        arrived_ = true;
        const auto unknown_before = loads_->num_unknown();
        if (loads_->add(message) != LoadBook::Entry::kTaken)
            warn_once(loads_warned_, "TOOL_LOADS refused: a force is not finite or time went backwards");
        if (unknown_before == 0 && loads_->num_unknown() > 0)
            warn_once(names_warned_,
                      "TOOL_LOADS names '" + loads_->first_unknown() + "', which the case does not have: ignored");
    }

    void take_markers(const markers_t& message) {
        if (!estimator_) return;
        if (queue_.size() >= static_cast<std::size_t>(settings.max_queue)) {
            queue_.pop_front();
            warn_once(queue_warned_, "marker frames arrive faster than they are worked through: oldest dropped");
            overflowed_ = true;
        }
        queue_.push_back(message);
        newest_marker_us_ = message.header.capture_stamp_us;
    }

    // Comes before the MARKERS of its frame.
    void take_surface(const surface_points_t& message) {
        if (surface_points_.size() > static_cast<std::size_t>(settings.max_queue)) surface_points_.pop_front();
        surface_points_.push_back(message);
    }

    SurfaceFrame surface_of(std::int64_t frame_us) {
        while (!surface_points_.empty() && surface_points_.front().header.capture_stamp_us < frame_us)
            surface_points_.pop_front();
        if (surface_points_.empty() || surface_points_.front().header.capture_stamp_us != frame_us) return {};
        const surface_points_t& m = surface_points_.front();
        return {m.feature_id, m.x_m, m.y_m, m.z_m, m.sigma_m, m.rest_x_m, m.rest_y_m, m.rest_z_m};
    }

    void take_cut(const cut_t& message) {
        if (!estimator_) return;
        const char* refusal = topology_ == nullptr       ? "the model cannot be cut"
                              : settings.keep_recording  ? "an offline estimate smooths over one topology"
                              : cuts_.size() >= kMaxCuts ? "too many cuts wait for a marker frame"
                                                         : nullptr;
        if (refusal != nullptr) {
            host_.log(TERES_LOG_WARN, "estimator", std::string("CUT refused: ") + refusal);
            return;
        }
        cuts_.push_back(message);
        auto& stamp = cuts_.back().header.capture_stamp_us;
        if (stamp <= 0) stamp = newest_marker_us_ + 1;
    }

    // Cuts that came before the frame.
    void follow_cuts(std::int64_t frame_us) noexcept {
        while (!cuts_.empty() && cuts_.front().header.capture_stamp_us <= frame_us) {
            const cut_t cut = std::move(cuts_.front());
            cuts_.pop_front();
            std::vector<std::int32_t> released, lost;
            for (std::size_t p = 0; p < model_->num_parameters(); ++p)
                if (std::ranges::find(cut.released, model_->parameter(p).name) != cut.released.end())
                    released.push_back(static_cast<std::int32_t>(p));
            const CutReport report = topology_->cut(cut.tet, released);
            if (report.outcome != CutOutcome::kDone || released.size() < cut.released.size())
                host_.log(
                    TERES_LOG_WARN, "estimator",
                    report.outcome == CutOutcome::kNothingHolds   ? "CUT refused: nothing would hold the body any more"
                    : report.outcome == CutOutcome::kNotSupported ? "CUT refused: elements of this kind cannot be cut"
                    : report.outcome == CutOutcome::kUnknownIndex
                        ? "CUT refused: it names a tetrahedron that the case does not have"
                        : "CUT names a parameter that the case does not have, or one twice: passed over");
            if (report.outcome != CutOutcome::kDone) continue;
            for (std::size_t j = 0; j < model_->num_markers(); ++j)
                if (topology_->marker_lost(j)) lost.push_back(static_cast<std::int32_t>(j));
            estimator_->follow_cut(released, lost);
            host_.log(TERES_LOG_INFO, "estimator",
                      "cut: " + std::to_string(report.tets_removed) + " tetrahedra gone, " +
                          std::to_string(released.size()) + " parameters released, " + std::to_string(lost.size()) +
                          " markers gone so far");
        }
    }

    teres_step_outcome work(const markers_t& m) noexcept {
        const MarkerFrame frame{m.header.capture_stamp_us,
                                m.marker_id,
                                m.x_m,
                                m.y_m,
                                m.z_m,
                                m.sigma_m,
                                surface_of(m.header.capture_stamp_us)};
        follow_cuts(frame.stamp_us);
        const std::int64_t unknown_before = estimator_->counters().markers_unknown;
        const FrameOutcome outcome = estimator_->step(frame, loads_->at(frame.stamp_us));
        if (outcome == FrameOutcome::kRefused) {
            warn_once(time_warned_, "MARKERS refused: time does not go forwards");
            return TERES_STEP_DEGRADED;
        }
        if (unknown_before == 0 && estimator_->counters().markers_unknown > 0)
            warn_once(ids_warned_, "MARKERS holds ids that the case does not have, or one twice: ignored");
        publish(m.header, outcome);
        const bool degraded = overflowed_ || outcome != FrameOutcome::kCorrected || !estimator_->converged();
        overflowed_ = false;
        return degraded ? TERES_STEP_DEGRADED : TERES_STEP_DONE;
    }

    void prepare_messages() {
        sequence_ = 0;
        const auto p = static_cast<std::int32_t>(model_->num_parameters());
        estimate_.num_parameters = p;
        estimate_.name.clear();
        estimate_.unit.clear();
        for (std::size_t i = 0; i < model_->num_parameters(); ++i) {
            estimate_.name.emplace_back(model_->parameter(i).name);
            estimate_.unit.emplace_back(model_->parameter(i).unit);
        }
        for (auto* field : {&estimate_.mean, &estimate_.stdev, &estimate_.observability, &estimate_.filter_mean})
            field->assign(model_->num_parameters(), 0.0);
        estimate_.num_covariance = p * (p + 1) / 2;
        estimate_.filter_covariance.assign(static_cast<std::size_t>(estimate_.num_covariance), 0.0);
        estimate_.filter_predicted_covariance = estimate_.filter_covariance;
        estimate_.node_id = estimator_->attachment_nodes();
        estimate_.num_nodes = static_cast<std::int32_t>(estimate_.node_id.size());
        estimate_.attachment_probability.assign(estimate_.node_id.size(), 0.0);

        liver_.num_nodes = static_cast<std::int32_t>(model_->num_nodes());
        for (auto* axis : {&liver_.x_m, &liver_.y_m, &liver_.z_m}) axis->assign(model_->num_nodes(), 0.0F);

        const std::size_t markers = model_->num_markers();
        innovation_.num_markers = static_cast<std::int32_t>(markers);
        innovation_.marker_id.clear();
        for (std::size_t j = 0; j < markers; ++j) innovation_.marker_id.push_back(model_->marker_id(j));
        innovation_.used.assign(markers, 0);
        for (auto* field : {&innovation_.dx_m, &innovation_.dy_m, &innovation_.dz_m, &innovation_.sigma_m})
            field->assign(markers, 0.0);
    }

    void publish(const header_t& source, FrameOutcome outcome) noexcept {
        header_t header;
        header.capture_stamp_us = source.capture_stamp_us;
        header.sequence = sequence_++;
        header.frame_id = source.frame_id;
        const bool stale = outcome != FrameOutcome::kCorrected;
        fill_estimate(header, stale);
        fill_liver(header, stale);
        fill_innovation(header);
        host_.publish("BOUNDARY_ESTIMATE", estimate_);
        host_.publish("LIVER_STATE", liver_);
        host_.publish("INNOVATION", innovation_);
    }

    void fill_estimate(const header_t& header, bool stale) noexcept {
        estimate_.header = header;
        estimate_.stale = stale;
        const ParameterMap& map = estimator_->parameters();
        const Eigen::VectorXd& theta = estimator_->theta();
        const Eigen::MatrixXd& P = estimator_->covariance();
        const Eigen::MatrixXd& predicted = estimator_->predicted_covariance();
        const Eigen::VectorXd observability = estimator_->observability();
        std::size_t entry = 0;
        for (Eigen::Index i = 0; i < theta.size(); ++i) {
            const auto k = static_cast<std::size_t>(i);
            estimate_.mean[k] = map.to_physical(i, theta(i));
            estimate_.stdev[k] = map.physical_stdev(i, theta(i), estimator_->stated_stdev(i, P(i, i)));
            estimate_.observability[k] = observability(i);
            estimate_.filter_mean[k] = theta(i);
            for (Eigen::Index j = 0; j <= i; ++j, ++entry) {
                estimate_.filter_covariance[entry] = P(i, j);
                estimate_.filter_predicted_covariance[entry] = predicted(i, j);
            }
        }
        estimator_->attachment_probabilities(estimate_.attachment_probability);
    }

    void fill_liver(const header_t& header, bool stale) noexcept {
        liver_.header = header;
        liver_.stale = stale;
        liver_.converged = estimator_->converged();
        liver_.relative_residual = estimator_->relative_residual();
        const Eigen::VectorXd& x = estimator_->state();
        for (std::size_t n = 0; n < model_->num_nodes(); ++n) {
            const auto row = static_cast<Eigen::Index>(3 * n);
            liver_.x_m[n] = static_cast<float>(x(row));
            liver_.y_m[n] = static_cast<float>(x(row + 1));
            liver_.z_m[n] = static_cast<float>(x(row + 2));
        }
    }

    void fill_innovation(const header_t& header) noexcept {
        innovation_.header = header;
        innovation_.nis = estimator_->nis();
        innovation_.degrees_of_freedom = estimator_->degrees_of_freedom();
        const Eigen::VectorXd& r = estimator_->residual();
        for (std::size_t j = 0; j < innovation_.used.size(); ++j) {
            const auto row = static_cast<Eigen::Index>(3 * j);
            innovation_.used[j] = static_cast<std::int8_t>(estimator_->gate().use[j]);
            innovation_.dx_m[j] = r(row);
            innovation_.dy_m[j] = r(row + 1);
            innovation_.dz_m[j] = r(row + 2);
            innovation_.sigma_m[j] = estimator_->gate().sigma[j];
        }
    }

    void warn_once(bool& warned, std::string_view text) noexcept {
        if (!warned) host_.log(TERES_LOG_WARN, "estimator", text);
        warned = true;
    }

    Host host_;
    BoundaryEstimatorOptions options_;
    ForwardModel* model_ = nullptr;
    std::optional<BoundaryEstimator> estimator_;
    std::optional<LoadBook> loads_;
    std::deque<markers_t> queue_;
    std::optional<SurfaceObservation> surface_;  // as new for every start
    std::deque<surface_points_t> surface_points_;
    Topology* topology_ = nullptr;
    std::deque<cut_t> cuts_;
    std::int64_t newest_marker_us_ = 0;
    SmootherResult smoothed_;
    bool overflowed_ = false, arrived_ = false;
    bool loads_warned_ = false, names_warned_ = false, queue_warned_ = false, time_warned_ = false, ids_warned_ = false;
    std::int64_t sequence_ = 0;
    boundary_estimate_t estimate_{};
    liver_state_t liver_{};
    innovation_t innovation_{};
};

}  // namespace teres

TERES_PLUGIN(teres::EstimatorPlugin, "estimator", "unscented Kalman filters: what holds the liver, from its markers",
             TERES_UNIT_PLUGIN)
