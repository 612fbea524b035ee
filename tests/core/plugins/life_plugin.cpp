// Writes down its life (create, configure, start, step, stop) and fails where the setting `fail_in` says.
#include "core/plugin_sdk.h"
#include "tests/core/plugins/life.h"

namespace {

struct Settings {
    std::string fail_in = "nowhere";
    double gain = 2.0;
    std::string case_folder;
    template <class V>
    void visit(V& field) {
        field("fail_in", fail_in, "nowhere|configure|start|throw", "which call fails");
        field("gain", gain, {0.0, 10.0}, "some number");
        field("case", case_folder, "", "case folder");
    }
};

class LifePlugin : public teres::Unit {
  public:
    using Settings = ::Settings;
    explicit LifePlugin(teres::Host host) : host_(host) { life_.calls.push_back("create"); }
    teres::Status configure() override {
        life_.calls.push_back("configure");
        life_.gain = settings.gain;
        life_.folder = settings.case_folder;
        if (settings.fail_in == "configure") return teres::invalid_input("gain of the wrong colour");
        return {};
    }
    teres::Status start() override {
        life_.calls.push_back("start");
        life_.saw_itself = host_.extension<teres::test::Life>() != nullptr;
        if (settings.fail_in == "throw") throw std::runtime_error("thrown on purpose");
        if (settings.fail_in == "start") return teres::host_fault("no such device");
        return {};
    }
    teres_step_outcome step(std::int64_t) noexcept override {
        if (life_.calls.back() != "step") life_.calls.push_back("step");
        return TERES_STEP_IDLE;
    }
    void stop() override { life_.calls.push_back("stop"); }
    void* extension(std::string_view id) override { return id == teres::test::Life::kId ? &life_ : nullptr; }

    Settings settings;

  private:
    teres::Host host_;
    teres::test::Life life_;
};

}  // namespace

TERES_PLUGIN(LifePlugin, "life", "writes its life down", TERES_UNIT_PLUGIN)
