// moving_attachment: what holds the body moves, as the diaphragm does with respiration. All anchors follow
//
//     b(t, X) = w(X) [ B(wt) - B(2 pi phi0) ],   B(p) = c1 cos p + s1 sin p + c2 cos 2p + s2 sin 2p,
//     w(X) = 1 + tilt . (X - Xm)/L
//
// The second harmonic makes the flat end of expiration; Xm middle of the anchored nodes, L size of the body. At some
// phase phi0 of its breath the body is where the nominal model has it, for there it was imaged: an offset that the
// swing never passes is a registration or another support, not respiration. Nor is what takes more than ten seconds a
// turn, or longer than five sixths of the recording: with its harmonics it could follow any drift.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "plugins/simulation/effects/effect.h"
#include "plugins/simulation/effects/places.h"

namespace teres {
namespace {

class MovingAttachment final : public Effect {
  public:
    explicit MovingAttachment(const Scene& scene) {
        d_.id = "moving_attachment";
        d_.kind = "boundary";
        d_.family = "moving_attachment";
        d_.summary = "attachments that move, as with respiration";
        d_.source = "CC 5.3+-2.2, AP 2.3+-1.1, LR 2.9+-1.2 mm: s13014-016-0762-z; 0.1-0.5 Hz assumed";
        for (const char* name : {"cos_x", "cos_y", "cos_z", "sin_x", "sin_y", "sin_z"})
            d_.parameters.push_back(amplitude(name, "m", EffectTransform::kIdentity, 0.0, 0.004, -0.04, 0.04));
        for (const char* name : {"cos2_x", "cos2_y", "cos2_z", "sin2_x", "sin2_y", "sin2_z"})
            d_.parameters.push_back(amplitude(name, "m", EffectTransform::kIdentity, 0.0, 0.0015, -0.02, 0.02));
        const double duration = scene.end_s - scene.start_s;
        const double slowest =
            duration > 0.0 ? std::clamp(1.0 / (kSeen * duration), kSlowest, kFastestTried) : kSlowest;
        d_.parameters.push_back(log_shape("frequency", "Hz", 0.25, 0.5, slowest, 2.0));
        for (const char* name : {"tilt_x", "tilt_y", "tilt_z"})
            d_.parameters.push_back(shape(name, "1", 0.0, 0.7, -5.0, 5.0));
        d_.parameters.push_back(shape("rest_phase", "1", 0.0, 0.3, -1.0, 1.0));  // phi0 [periods]
        if (scene.parts.tethers.empty()) {
            d_.not_applicable = "nothing holds the body but tools";
            return;
        }
        if (!(duration > 0.0)) {
            d_.not_applicable = "the recording has one instant only";
            return;
        }
        for (std::size_t t = 0; t < scene.parts.tethers.size(); ++t)
            middle_ += scene.mesh.X.col(scene.parts.tethers[t].node) / static_cast<double>(scene.parts.tethers.size());
        const double step = std::max(0.5 / duration, 0.4 / 16.0);  // a quarter turn over half the recording
        std::vector<double> values = central_candidate(d_.parameters);
        for (double f = slowest; f <= kFastestTried + 1e-9; f += step)
            for (const double rest_phase : {0.0, 1.0 / 3.0, -1.0 / 3.0}) {
                values[kFrequency] = f;
                values[kRestPhase] = rest_phase;
                d_.candidates.push_back(values);
            }
    }
    void apply(std::span<const double> v, Scene& scene) const override {
        const auto swing = [&](double phase) -> Eigen::Vector3d {  // B
            const double basis[4] = {std::cos(phase), std::sin(phase), std::cos(2.0 * phase), std::sin(2.0 * phase)};
            Eigen::Vector3d sum = Eigen::Vector3d::Zero();
            for (std::size_t k = 0; k < 4; ++k) sum += basis[k] * Eigen::Vector3d(v[3 * k], v[3 * k + 1], v[3 * k + 2]);
            return sum;
        };
        constexpr double kTurn = 2.0 * std::numbers::pi;
        const Eigen::Vector3d b =
            swing(kTurn * v[kFrequency] * (scene.t_s - scene.start_s)) - swing(kTurn * v[kRestPhase]);
        const Eigen::Vector3d tilt = Eigen::Vector3d(v[kTilt], v[kTilt + 1], v[kTilt + 2]) / scene.size_m;
        for (std::size_t k = 0; k < scene.tethers.clamp_end; ++k) {
            Tether& t = scene.ties()[k];
            const Eigen::Vector3d shift = (1.0 + tilt.dot(scene.mesh.X.col(t.node) - middle_)) * b;
            t.band.rest += shift;
            t.spring.anchor += shift;
            t.fan.middle += shift;
            for (auto& spring : t.fan.far) spring.anchor += shift;
        }
    }

  private:
    static constexpr double kSlowest = 0.1, kFastestTried = 0.5;  // [Hz]
    static constexpr double kSeen = 5.0 / 6.0;                    // of the recording: a turn is seen by then
    static constexpr std::size_t kFrequency = 12, kTilt = 13, kRestPhase = 16;  // after the twelve amplitudes
    Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();                          // Xm
};

}  // namespace

std::unique_ptr<Effect> make_moving_attachment(const Scene& nominal) {
    return std::make_unique<MovingAttachment>(nominal);
}

}  // namespace teres
