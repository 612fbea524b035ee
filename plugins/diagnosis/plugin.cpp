// Unit `diagnosis`: offers teres.gap_diagnosis/1 to offline commands.
#include <string>

#include "core/extensions/gap_diagnosis.h"
#include "core/plugin_sdk.h"
#include "plugins/diagnosis/diagnosis.h"
#include "plugins/diagnosis/gap_json.h"
#include "plugins/diagnosis/settings.h"

namespace teres {

class DiagnosisPlugin final : public Unit, public GapDiagnosis {
  public:
    using Settings = DiagnosisSettings;
    Settings settings;

    explicit DiagnosisPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override { return {}; }
    teres_step_outcome step(std::int64_t) noexcept override { return TERES_STEP_IDLE; }
    void* extension(std::string_view id) override {
        return id == GapDiagnosis::kId ? static_cast<GapDiagnosis*>(this) : nullptr;
    }

    // GapDiagnosis
    std::int32_t diagnose(const GapRequest& request) noexcept override {
        try {
            const Status status = work(request);
            if (status) return 0;
            error_ = status.error().text;
            return static_cast<std::int32_t>(status.error().kind);
        } catch (const std::exception& e) {
            error_ = e.what();
            return static_cast<std::int32_t>(ErrorKind::kHostFault);
        }
    }
    const char* error() const noexcept override { return error_.c_str(); }
    const char* gap_json() const noexcept override { return gap_.c_str(); }
    const char* report_json() const noexcept override { return report_.c_str(); }
    std::span<const double> points_m() const noexcept override { return points_; }

  private:
    Status work(const GapRequest& request) {
        if (request.recordings.empty()) return invalid_input("no recording given");
        const GapRecording& first = request.recordings.front();
        const EffectTable effects(*first.mechanics, first.sensors, request.excluded);
        DiagnosisOptions options;
        options.cache = request.cache_folder != nullptr ? request.cache_folder : "";
        options.max_effects = request.max_effects;
        options.num_refits = settings.num_refits;
        if (request.progress != nullptr)
            options.progress = [&](const char* stage, double part) { return request.progress(request.user, stage, part); };
        for (const char* id : request.excluded)
            if (effects.find(id) == effects.size()) return invalid_input(std::string("no effect is called ") + id);
        if (request.plan_only) {
            TERES_TRY_ASSIGN(const Plan result, plan(first, effects, options));
            gap_ = plan_json(result, effects, options.calibration);
            report_.clear();
            points_.clear();
            return {};
        }
        TERES_TRY_ASSIGN(const Diagnosis result, teres::diagnose(request.recordings, effects, options));
        gap_ = teres::gap_json(result, effects, *first.mechanics, options.calibration);
        report_ = teres::report_json(result, effects, *first.mechanics, options.calibration);
        points_ = result.points_m;
        return {};
    }

    Host host_;
    std::string error_, gap_, report_;
    std::vector<double> points_;
};

}  // namespace teres

TERES_PLUGIN(teres::DiagnosisPlugin, "diagnosis", "where simulation and reality part, and which missing effect is to blame",
             TERES_UNIT_PLUGIN)
