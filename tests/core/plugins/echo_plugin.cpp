// Holds one frame of MARKERS and answers it with INNOVATION in its step, `rounds` steps later: a frame that
// comes while another is held is lost, and shows as a gap in the answers.
#include "core/plugin_sdk.h"
#include "teres/innovation_t.hpp"
#include "teres/markers_t.hpp"

namespace {

struct Settings {
    int rounds = 3;
    bool degraded = false;
    template <class V>
    void visit(V& field) {
        field("rounds", rounds, {1, 50}, "steps that one frame takes");
        field("degraded", degraded, "call every step degraded");
    }
};

class EchoPlugin : public teres::Unit {
  public:
    using Settings = ::Settings;
    explicit EchoPlugin(teres::Host host) : host_(host) {}
    teres::Status configure() override {
        return host_.subscribe<teres::markers_t>("MARKERS", 4096,
                                                 [this](const teres::markers_t& message, std::int64_t) {
                                                     held_ = message;
                                                     left_ = settings.rounds;
                                                 });
    }
    teres_step_outcome step(std::int64_t now_us) noexcept override {
        if (left_ == 0) return TERES_STEP_IDLE;
        if (--left_ == 0) {
            teres::innovation_t answer;
            answer.header = held_.header;
            answer.nis = held_.x_m[0] + 1e-9 * static_cast<double>(now_us);
            answer.degrees_of_freedom = 1;
            answer.num_markers = 0;
            host_.publish("INNOVATION", answer);
        }
        return settings.degraded ? TERES_STEP_DEGRADED : TERES_STEP_DONE;
    }

    Settings settings;

  private:
    teres::Host host_;
    teres::markers_t held_;
    int left_ = 0;
};

}  // namespace

TERES_PLUGIN(EchoPlugin, "echo", "answers every frame", TERES_UNIT_PLUGIN)
