// camera_drift: the camera creeps while it records.
//
//     p'(t) = p(t) + d (t - t0)/(t1 - t0),     d the shift reached at the recording's end
#include "plugins/observation/effects/sensor_effect.h"

namespace teres {
namespace {

class CameraDrift final : public SensorEffect {
  public:
    explicit CameraDrift(const SensorScene& scene) : start_s_(scene.start_s), duration_s_(scene.end_s - scene.start_s) {
        d_.id = "camera_drift";
        d_.kind = "sensor";
        d_.family = "camera_drift";
        d_.summary = "camera that creeps during the recording";
        d_.source = "assumed: 2-5 mm in a recording";
        for (const char* name : {"drift_x", "drift_y", "drift_z"})
            d_.parameters.push_back(amplitude(name, "m", EffectTransform::kIdentity, 0.0, 0.004, -0.05, 0.05));
        if (duration_s_ > 0.0)
            d_.candidates.push_back(central_candidate(d_.parameters));
        else
            d_.not_applicable = "the recording has one instant only";
    }
    void observe(std::span<const double> v, Sighting& sighting) const override {
        if (!(duration_s_ > 0.0)) return;
        const Eigen::Vector3d d(v[0], v[1], v[2]);
        for (std::size_t f = 0; f < sighting.time_s.size(); ++f)
            sighting.position.middleCols(sighting.column(f, 0), static_cast<Eigen::Index>(sighting.num_markers))
                .colwise() += (sighting.time_s[f] - start_s_) / duration_s_ * d;
    }

  private:
    double start_s_, duration_s_;
};

}  // namespace

std::unique_ptr<SensorEffect> make_camera_drift(const SensorScene& scene) {
    return std::make_unique<CameraDrift>(scene);
}

}  // namespace teres
