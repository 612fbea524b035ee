// Unit `centroid`: publishes the centroid of the markers that are seen in a frame, c = (1/n) sum of x_i, on
// CENTROID.
#include <core/plugin_sdk.h>

#include <cmath>
#include <teres/markers_t.hpp>

namespace {

class Centroid final : public teres::Unit {
  public:
    struct Settings {
        int min_markers = 1;
        template <class V>
        void visit(V& field) {
            field("min_markers", min_markers, {1, 10'000}, "frames with fewer seen markers are left out");
        }
    };
    Settings settings;

    explicit Centroid(teres::Host host) : host_(std::move(host)) {}

    // [setup]
    teres::Status configure() override { return {}; }
    teres::Status start() override {
        return host_.subscribe<teres::markers_t>("MARKERS", 1 << 20,
                                                 [this](const teres::markers_t& frame, std::int64_t) {
                                                     frame_ = frame;
                                                     fresh_ = true;
                                                 });
    }

    // [loop] Handlers have run before; whatever they left is worked off here.
    teres_step_outcome step(std::int64_t) noexcept override {
        if (!fresh_) return TERES_STEP_IDLE;
        fresh_ = false;
        double x = 0.0, y = 0.0, z = 0.0;
        int seen = 0;
        for (int i = 0; i < frame_.num_markers; ++i) {
            if (std::isnan(frame_.x_m[i])) continue;  // lost in this frame
            x += frame_.x_m[i];
            y += frame_.y_m[i];
            z += frame_.z_m[i];
            ++seen;
        }
        if (seen < settings.min_markers) return TERES_STEP_DEGRADED;
        out_.header = frame_.header;
        out_.header.sequence = ++sequence_;
        out_.num_markers = 1;
        out_.marker_id = {0};
        out_.x_m = {x / seen};
        out_.y_m = {y / seen};
        out_.z_m = {z / seen};
        out_.sigma_m = {0.0};
        host_.publish("CENTROID", out_);
        return TERES_STEP_DONE;
    }

  private:
    teres::Host host_;
    teres::markers_t frame_, out_;
    std::int64_t sequence_ = 0;
    bool fresh_ = false;
};

}  // namespace

TERES_PLUGIN(Centroid, "centroid", "centroid of the seen markers", TERES_UNIT_PLUGIN)
