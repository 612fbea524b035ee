// The forward model with effects of the catalogue as further unknowns: ligament groups first, then the parameters of
// each effect, so that a filter estimates both alike. Every lane has a body, supports and loads of its own, hence the
// lanes are solved one after the other: for recordings, not for camera rate.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/extensions/forward_model.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

class EffectModel final : public ForwardModel {
  public:
    /// `ids`: mechanical effects. Errors (kInvalidInput): an id that is no mechanical effect or not applicable to this
    /// case (with the reason), an effect with memory, a dynamic case.
    static Result<std::unique_ptr<EffectModel>> make(const Case& c, const PlayerSettings& settings,
                                                     const std::vector<std::string>& ids);

    std::size_t num_nodes() const override { return nominal().num_nodes(); }
    std::size_t num_state() const override { return 3 * num_nodes(); }
    std::size_t num_parameters() const override { return nominal().num_parameters() + unknown_.size(); }
    ForwardParameter parameter(std::size_t index) const override;
    std::size_t num_attachment_nodes() const override { return nominal().num_attachment_nodes(); }
    AttachmentNode attachment_node(std::size_t index) const override { return nominal().attachment_node(index); }
    std::size_t num_regions() const override { return nominal().num_regions(); }
    const char* region_name(std::size_t index) const override { return nominal().region_name(index); }
    std::size_t num_tools() const override { return nominal().num_tools(); }
    const char* tool_name(std::size_t index) const override { return nominal().tool_name(index); }
    std::size_t num_markers() const override { return nominal().num_markers(); }
    std::int32_t marker_id(std::size_t index) const override { return nominal().marker_id(index); }
    std::size_t num_points() const override { return nominal().num_points(); }
    std::int32_t point_id(std::size_t index) const override { return nominal().point_id(index); }
    void rest_state(std::span<double> x) const override { nominal().rest_state(x); }
    ForwardReport advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                          std::size_t lanes) noexcept override;
    void observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept override {
        nominal().observe(X, Z, lanes);
    }
    void predict_points(std::span<const double> x, std::span<double> out) const noexcept override {
        nominal().predict_points(x, out);
    }

  private:
    struct Unknown {
        std::string name;  // "gravity.g_x"
        std::size_t effect, parameter;
    };
    EffectModel() = default;
    CaseModel& nominal() const { return player_->model(); }

    std::unique_ptr<ScenePlayer> player_;
    std::vector<std::unique_ptr<Effect>> effects_;
    std::vector<Unknown> unknown_;
    // of one lane
    std::vector<std::vector<double>> values_;  // per effect that is on; what is no unknown stays at its prior
    std::vector<EffectInstance> on_;
    ScenePlayer::KnownLoads loads_;
};

}  // namespace teres
