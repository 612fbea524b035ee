// A driver with a made-up recording: `frames` MARKERS of one marker that moves by 1 mm a frame at 10 Hz of
// its own clock, as fast as it is stepped or one every `period_ms`.
#include <ctime>

#include "core/extensions/stream_clock.h"
#include "core/plugin_sdk.h"
#include "teres/markers_t.hpp"

namespace {

struct Settings {
    int frames = 10;
    double period_ms = 0.0;
    bool endless = false;
    int skip_every = 0;
    template <class V>
    void visit(V& field) {
        field("frames", frames, {0, 1'000'000}, "number of frames");
        field("period_ms", period_ms, {0.0, 10'000.0}, "pace; 0: as fast as possible");
        field("endless", endless, "never ends");
        field("skip_every", skip_every, {0, 1000}, "leave out every n-th frame; 0: none");
    }
};

class RampDriver : public teres::Unit, public teres::StreamClock {
  public:
    using Settings = ::Settings;
    explicit RampDriver(teres::Host host) : host_(host) {}
    teres::Status configure() override { return {}; }
    teres_step_outcome step(std::int64_t) noexcept override {
        if (!settings.endless && frame_ >= settings.frames) return TERES_STEP_FINISHED;
        if (settings.period_ms > 0.0) {
            timespec t{};
            clock_gettime(CLOCK_MONOTONIC, &t);
            const double ms = 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
            if (ms < due_ms_) return TERES_STEP_IDLE;
            due_ms_ = ms + settings.period_ms;
        }
        ++frame_;
        if (settings.skip_every > 0 && frame_ % settings.skip_every == 0) ++frame_;
        teres::markers_t markers;
        markers.header.capture_stamp_us = now_us();
        markers.header.sequence = frame_;
        markers.header.frame_id = "test";
        markers.num_markers = 1;
        markers.marker_id = {0};
        markers.x_m = {1e-3 * frame_};
        markers.y_m = markers.z_m = {0.0};
        markers.sigma_m = {1e-4};
        host_.publish("MARKERS", markers);
        return TERES_STEP_DONE;
    }
    void* extension(std::string_view id) override {
        return id == teres::StreamClock::kId ? static_cast<teres::StreamClock*>(this) : nullptr;
    }
    std::int64_t now_us() const noexcept override { return 1'000'000 + 100'000 * frame_; }

    Settings settings;

  private:
    teres::Host host_;
    std::int64_t frame_ = 0;
    double due_ms_ = 0.0;
};

}  // namespace

TERES_PLUGIN(RampDriver, "ramp", "one marker on a ramp", TERES_UNIT_DRIVER)
