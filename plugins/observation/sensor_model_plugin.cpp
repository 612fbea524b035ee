// Unit `sensor_model`: reads the case, offers teres.observation_model/1 (sensor effects). No messages.
#include "core/case/case_reader.h"
#include "core/plugin_sdk.h"
#include "plugins/observation/sensor_model.h"

namespace teres {

struct SensorModelSettings {
    std::string case_folder;
    template <class V>
    void visit(V& field) {
        field("case", case_folder, "", "case folder (teres-case-1); empty: that of [service]");
    }
};

class SensorModelPlugin final : public Unit {
  public:
    using Settings = SensorModelSettings;
    Settings settings;

    explicit SensorModelPlugin(Host) {}

    Status configure() override {
        if (settings.case_folder.empty())
            return invalid_input("sensor_model.case (or service.case) names no case folder");
        TERES_TRY_ASSIGN(const Case c, read_case(settings.case_folder));
        model_ = std::make_unique<SensorModel>(c);
        return {};
    }
    teres_step_outcome step(std::int64_t) noexcept override { return TERES_STEP_IDLE; }
    void* extension(std::string_view id) override {
        return id == ObservationModel::kId && model_ ? static_cast<ObservationModel*>(model_.get()) : nullptr;
    }

  private:
    std::unique_ptr<SensorModel> model_;
};

}  // namespace teres

TERES_PLUGIN(teres::SensorModelPlugin, "sensor_model", "what camera and tracking do to true marker positions",
             TERES_UNIT_PLUGIN)
