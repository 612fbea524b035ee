// Unit `diagnosis`. Live: INNOVATION and MARKERS in, GAP out, one per frame. Offline: offers GapDiagnosis.
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <optional>
#include <string>
#include <unordered_map>

#include "core/extensions/gap_diagnosis.h"
#include "core/plugin_sdk.h"
#include "plugins/diagnosis/diagnosis.h"
#include "plugins/diagnosis/gap_json.h"
#include "plugins/diagnosis/innovation_watch.h"
#include "plugins/diagnosis/judged_again.h"
#include "plugins/diagnosis/settings.h"
#include "teres/gap_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/markers_t.hpp"

namespace teres {
namespace {

constexpr std::size_t kMaxMessageBytes = 1 << 20;
constexpr std::size_t kMaxQueue = 8;       // innovations that may wait; beyond it the oldest is dropped
constexpr std::size_t kMaxMarkers = 4096;  // places remembered
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace

class DiagnosisPlugin final : public Unit, public GapDiagnosis {
  public:
    using Settings = DiagnosisSettings;
    Settings settings;

    explicit DiagnosisPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override { return {}; }
    Status start() override {
        watch_.reset();
        queue_.clear();
        place_.clear();
        TERES_TRY(host_.subscribe<markers_t>("MARKERS", kMaxMessageBytes,
                                             [this](const markers_t& m, std::int64_t) { take_places(m); }));
        return host_.subscribe<innovation_t>("INNOVATION", kMaxMessageBytes,
                                             [this](const innovation_t& m, std::int64_t) {
                                                 queue_.push_back(m);
                                                 if (queue_.size() > kMaxQueue) queue_.pop_front();
                                             });
    }
    teres_step_outcome step(std::int64_t) noexcept override {
        if (queue_.empty()) return TERES_STEP_IDLE;
        const innovation_t frame = std::move(queue_.front());
        queue_.pop_front();
        watch(frame);
        return TERES_STEP_DONE;
    }
    void* extension(std::string_view id) override {
        return id == GapDiagnosis::kId ? static_cast<GapDiagnosis*>(this) : nullptr;
    }

    // GapDiagnosis
    std::int32_t diagnose(const GapRequest& request) noexcept override {
        return exit_code([&] { return work(request); });
    }
    std::int32_t judge_again(const char* gap_json) noexcept override {
        return exit_code([&]() -> Status {
            TERES_TRY_ASSIGN(json_, judged_again(gap_json, Calibration{}));
            report_.clear();
            points_.clear();
            nominal_points_.clear();
            return {};
        });
    }
    const char* error() const noexcept override { return error_.c_str(); }
    const char* gap_json() const noexcept override { return json_.c_str(); }
    const char* report_json() const noexcept override { return report_.c_str(); }
    std::span<const double> points_m() const noexcept override { return points_; }
    std::span<const double> nominal_points_m() const noexcept override { return nominal_points_; }

  private:
    void take_places(const markers_t& m) {
        for (std::size_t k = 0; k < m.marker_id.size(); ++k)
            if (std::isfinite(m.x_m[k] + m.y_m[k] + m.z_m[k]) &&
                (place_.contains(m.marker_id[k]) || place_.size() < kMaxMarkers))
                place_[m.marker_id[k]] = {m.x_m[k], m.y_m[k], m.z_m[k]};
    }

    void watch(const innovation_t& m) noexcept {
        if (!watch_ || ids_ != m.marker_id) {  // other markers: learn anew
            ids_ = m.marker_id;
            watch_.emplace(ids_.size(), settings.watch_options());
            innovations_.resize(ids_.size());
        }
        for (std::size_t k = 0; k < ids_.size(); ++k)
            innovations_[k] = {{m.dx_m[k], m.dy_m[k], m.dz_m[k]}, m.sigma_m[k], m.used[k] != 0};
        const bool before = watch_->state().alarm;
        const GapState& state = watch_->update(m.header.capture_stamp_us, innovations_);
        gap_.header = m.header;
        gap_.header.sequence = sequence_++;
        gap_.alarm = state.alarm;
        gap_.kind = state.kind == GapKind::kSensor      ? "sensor"
                    : state.kind == GapKind::kMechanics ? "mechanics"
                                                        : "none";
        gap_.onset_stamp_us = state.onset_us;
        gap_.statistic = state.statistic;
        gap_.bound = state.bound;
        gap_.num_markers = static_cast<std::int32_t>(ids_.size());
        gap_.marker_id = ids_;
        gap_.marker_statistic = state.marker_statistic;
        if (!state.alarm || !before) place_alarm(state);  // where it was when it began
        host_.publish("GAP", gap_);
        if (state.alarm && !before)
            host_.log(TERES_LOG_WARN, "diagnosis",
                      "the filter no longer explains the markers: " + gap_.kind + ", since " +
                          std::to_string(1e-6 * static_cast<double>(state.onset_us)) + " s");
    }

    // Centre and radius of the shifted markers, weighted by the square of their shift.
    void place_alarm(const GapState& state) noexcept {
        gap_.center_x_m = gap_.center_y_m = gap_.center_z_m = gap_.radius_m = kNaN;
        if (!state.alarm) return;
        double total = 0.0, sum[3] = {0.0, 0.0, 0.0}, square = 0.0;
        for (std::size_t k = 0; k < ids_.size(); ++k) {
            const auto at = place_.find(ids_[k]);
            if (at == place_.end()) continue;
            const double w = state.marker_shift[k] * state.marker_shift[k];
            total += w;
            for (std::size_t a = 0; a < 3; ++a) {
                sum[a] += w * at->second[a];
                square += w * at->second[a] * at->second[a];
            }
        }
        if (!(total > 0.0)) return;
        gap_.center_x_m = sum[0] / total;
        gap_.center_y_m = sum[1] / total;
        gap_.center_z_m = sum[2] / total;
        gap_.radius_m =
            std::sqrt(std::max(0.0, square / total - gap_.center_x_m * gap_.center_x_m -
                                        gap_.center_y_m * gap_.center_y_m - gap_.center_z_m * gap_.center_z_m));
    }

    template <class Work>
    std::int32_t exit_code(const Work& work) noexcept {
        try {
            const Status status = work();
            if (status) return 0;
            error_ = status.error().text;
            return static_cast<std::int32_t>(status.error().kind);
        } catch (const std::exception& e) {
            error_ = e.what();
            return static_cast<std::int32_t>(ErrorKind::kHostFault);
        }
    }

    Status work(const GapRequest& request) {
        if (request.recordings.empty()) return invalid_input("no recording given");
        const GapRecording& first = request.recordings.front();
        const EffectTable effects(*first.mechanics, first.sensors, request.excluded);
        DiagnosisOptions options;
        options.cache = request.cache_folder != nullptr ? request.cache_folder : "";
        options.max_effects = request.max_effects;
        options.num_refits = settings.num_refits;
        options.work_limit_s = first.mechanics->dynamic() ? settings.work_limit_dynamic_s : settings.work_limit_s;
        if (request.progress != nullptr)
            options.progress = [&](const char* stage, double part) {
                return request.progress(request.user, stage, part);
            };
        for (const char* id : request.excluded)
            if (effects.find(id) == effects.size()) return invalid_input(std::string("no effect is called ") + id);
        if (request.plan_only) {
            TERES_TRY_ASSIGN(const Plan result, plan(first, effects, options));
            json_ = plan_json(result, effects, options.calibration);
            report_.clear();
            points_.clear();
            nominal_points_.clear();
            return {};
        }
        TERES_TRY_ASSIGN(const Diagnosis result, teres::diagnose(request.recordings, effects, options));
        json_ = teres::gap_json(result, effects, *first.mechanics, options.calibration);
        report_ = teres::report_json(result, effects, *first.mechanics, options.calibration);
        points_ = result.points_m;
        nominal_points_ = result.nominal_points_m;
        return {};
    }

    Host host_;
    // live
    std::optional<InnovationWatch> watch_;
    std::deque<innovation_t> queue_;
    std::vector<std::int32_t> ids_;
    std::vector<MarkerInnovation> innovations_;
    std::unordered_map<std::int32_t, std::array<double, 3>> place_;
    gap_t gap_{};
    std::int64_t sequence_ = 0;
    // offline
    std::string error_, json_, report_;
    std::vector<double> points_, nominal_points_;
};

}  // namespace teres

TERES_PLUGIN(teres::DiagnosisPlugin, "diagnosis",
             "where simulation and reality part, and which missing effect is to blame", TERES_UNIT_PLUGIN)
