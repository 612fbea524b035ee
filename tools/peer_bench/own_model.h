// The mechanical model of a folder behind teres.forward_model/1, so that the product's own estimator runs on
// it.
//
// What the model is told: when the tool was attached and where it stood (time stamps and the button of the
// device), the loads, the prior. What it is not told: the true parameters, events (a cut), the generator's
// velocity damping. The last is estimated with the rest: parameter `velocity_damping`.
#pragma once

#include <memory>
#include <vector>

#include "core/extensions/forward_model.h"
#include "tools/peer_bench/peer_model.h"

namespace teres::peer {

/// Weights beyond this extrapolate: the observation would be a lever far outside the body. Such points are
/// refused.
inline constexpr double kLargestWeight = 2.0;

class OwnModel final : public ForwardModel {
  public:
    /// Keeps references to both. `inputs`: the run whose tool and load alignment holds (the generator).
    OwnModel(const Scene& scene, const PeerModel& model, std::size_t threads);

    std::size_t num_nodes() const override { return scene_.mesh.nodes.size(); }
    std::size_t num_state() const override { return (is_static() ? 3 : 6) * num_nodes(); }
    std::size_t num_parameters() const override { return parameters_.size(); }
    ForwardParameter parameter(std::size_t index) const override { return parameters_[index]; }
    std::size_t num_attachment_nodes() const override { return 0; }
    AttachmentNode attachment_node(std::size_t) const override { return {}; }
    std::size_t num_regions() const override { return 0; }
    const char* region_name(std::size_t) const override { return ""; }
    std::size_t num_tools() const override { return 0; }
    const char* tool_name(std::size_t) const override { return ""; }
    std::size_t num_markers() const override { return points_.size(); }
    std::int32_t marker_id(std::size_t index) const override { return static_cast<std::int32_t>(kept_[index]); }
    std::size_t num_points() const override { return 0; }
    std::int32_t point_id(std::size_t) const override { return 0; }
    void rest_state(std::span<double> x) const override;

    ForwardReport advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                          std::size_t lanes) noexcept override;
    void observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept override;
    void predict_points(std::span<const double>, std::span<double>) const noexcept override {}

    /// Indices into the folder's observed points of the markers, and of those refused.
    const std::vector<std::size_t>& kept() const { return kept_; }
    const std::vector<std::size_t>& refused() const { return refused_; }
    /// Number of the folder's own parameters (the damping stands behind them).
    std::size_t num_folder_parameters() const { return scene_.filter.names.size(); }

  private:
    bool is_static() const { return model_.run().integrator == Integrator::kStatic; }

    const Scene& scene_;
    const PeerModel& model_;
    std::vector<ForwardParameter> parameters_;
    std::vector<ObservedPoint> points_;
    std::vector<std::size_t> kept_, refused_;
    std::vector<std::unique_ptr<PeerModel::Lane>> lanes_;
};

}  // namespace teres::peer
