// The sensor effects of a case as teres.observation_model/1.
#pragma once

#include <memory>
#include <vector>

#include "core/case/case.h"
#include "core/extensions/trajectory_model.h"
#include "plugins/observation/effects/sensor_effect.h"

namespace teres {

class SensorModel final : public ObservationModel {
  public:
    explicit SensorModel(const Case& c);

    std::size_t num_effects() const noexcept override { return effects_.size(); }
    EffectInfo effect(std::size_t index) const noexcept override { return effects_[index]->description().info(); }
    EffectParameter effect_parameter(std::size_t effect, std::size_t parameter) const noexcept override {
        return effects_[effect]->description().parameters[parameter];
    }
    void effect_candidate(std::size_t effect, std::size_t candidate, std::span<double> values) const noexcept override;

    /// Effects act in the order of the catalogue, whatever that of `effects`.
    void observe(std::span<const EffectInstance> effects, std::span<const double> time_s,
                 std::span<const double> markers_true_m, std::span<double> markers_observed_m) const noexcept override;
    double noise_factor(std::span<const EffectInstance> effects) const noexcept override;

  private:
    std::vector<std::unique_ptr<SensorEffect>> effects_;
};

}  // namespace teres
