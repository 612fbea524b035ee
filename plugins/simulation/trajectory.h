// Whole recordings of a case under hypotheses (teres.trajectory_model): simulation, and the first-order
// response of the markers to other hypotheses by one compliance matrix per frame,
//
//     K_f dx = -(g(x_f; other) - g(x_f; base)),   dz_f = H_f dx = -C_f dg,   C_f = H_f K_f^-1   (3M x 3N)
//
// x_f: the base trajectory, H_f: derivative of the markers by the nodes. C is made (and kept in single precision) at a
// few frames far apart in the space of shapes; every frame takes that of the nearest shape, its gradient change is
// its own. A dynamic case responds by the modes about the frame next to the mean of its trajectory (modal_response.h).
//
// A hypothesis that parts the body (Effect::crack) is simulated by a mesh that is parted (parted_body.h) from that
// instant on; x_f and first order stay those of the whole body under the same hypothesis.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "plugins/simulation/base_trajectory.h"
#include "plugins/simulation/gradient_change.h"
#include "plugins/simulation/model_variants.h"
#include "plugins/simulation/parted_body.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

class Trajectory final : public TrajectoryModel {
  public:
    /// Errors: of CaseModel::make.
    static Result<std::unique_ptr<Trajectory>> make(const Case& c, const PlayerSettings& settings);

    std::size_t num_effects() const noexcept override { return effects_.size(); }
    EffectInfo effect(std::size_t index) const noexcept override { return effects_[index]->description().info(); }
    EffectParameter effect_parameter(std::size_t effect, std::size_t parameter) const noexcept override {
        return effects_[effect]->description().parameters[parameter];
    }
    void effect_candidate(std::size_t effect, std::size_t candidate, std::span<double> values) const noexcept override;

    bool ligament_shares(std::span<double> of_node) const noexcept override;
    void settle_effect(std::size_t effect, std::span<double> values) const noexcept override;

    std::size_t num_parameters() const noexcept override { return player_->model().num_parameters(); }
    NominalParameter parameter(std::size_t index) const noexcept override;
    std::size_t num_frames() const noexcept override { return player_->times().size(); }
    double time_s(std::size_t frame) const noexcept override { return player_->times()[frame]; }
    bool dynamic() const noexcept override { return player_->scene().dynamic; }
    void set_horizon(std::size_t frames) noexcept override { horizon_ = dynamic() ? frames : 0; }
    std::size_t num_markers() const noexcept override { return player_->model().num_markers(); }
    std::int32_t marker_id(std::size_t index) const noexcept override { return player_->model().marker_id(index); }
    std::size_t num_points() const noexcept override { return player_->model().num_points(); }
    std::int32_t point_id(std::size_t index) const noexcept override { return player_->model().point_id(index); }

    std::size_t num_nodes() const noexcept override { return player_->model().mesh().num_nodes(); }
    void rest_positions(std::span<double> x_m) const noexcept override;
    std::size_t num_surface_triangles() const noexcept override { return player_->model().mesh().surface.size(); }
    void surface_triangles(std::span<std::int32_t> node) const noexcept override;

    TrajectoryReport simulate(const Hypothesis& h, std::span<double> markers_m, std::span<double> points_m,
                              std::span<double> nodes_m) noexcept override;
    TrajectoryReport approximate(const Hypothesis& h, std::span<double> markers_m) noexcept override;
    void rebase() noexcept override;
    TrajectoryReport simulate_at(const Hypothesis& h, std::span<const std::int32_t> frames,
                                 std::span<double> markers_m) noexcept override;
    bool first_order(std::span<const Hypothesis> others, std::span<double> markers_m,
                     std::span<double> points_m) noexcept override;
    bool marker_compliance(std::int32_t node, std::span<double> out) const noexcept override;

    bool effect_forces(std::size_t which, std::span<double> rms_n) const noexcept override;
    std::size_t num_variants() const noexcept override { return variants_.size(); }
    const char* variant_name(std::size_t index) const noexcept override { return variants_[index].name.c_str(); }
    double variant_share(std::size_t index) const noexcept override { return variants_[index].share; }
    TrajectoryReport simulate_variant(std::size_t index, const Hypothesis& h, std::span<const std::int32_t> frames,
                                      std::span<double> markers_m, std::span<double> points_m) noexcept override;
    TrajectoryModel* twin() noexcept override;
    void share_with_twin(bool on) noexcept override;

    ScenePlayer& player() { return *player_; }
    const std::vector<std::unique_ptr<Effect>>& effects() const { return effects_; }

  private:
    Trajectory() = default;
    TrajectoryReport play_all(const Hypothesis& h, std::span<double> markers_m, std::span<double> points_m,
                              std::span<double> nodes_m, SubspaceSolver* subspace);
    TrajectoryReport play_frames(const Hypothesis& h, std::span<const std::int32_t> frames,
                                 const std::vector<Eigen::VectorXd>& before, const ScenePlayer::Visitor& visit);
    TrajectoryReport move_in_subspace(const Hypothesis& h, std::span<double> markers_m);
    std::optional<Crack> how_parted(const Hypothesis& h) const;
    std::span<const Eigen::VectorXd> whole_positions() const;
    TrajectoryReport play_parted(const Hypothesis& h, const Crack& crack, std::span<double> markers_m,
                                 std::span<double> points_m, std::span<double> nodes_m);
    Eigen::MatrixXd motions_under(const Hypothesis& h) const;
    void prepare_compliance(const ExternalActions& actions, const Eigen::VectorXd& x, bool points,
                            BaseTrajectory::Compliance& out) const;
    void prepare_compliances_at(const std::vector<std::size_t>& knots, std::size_t first, std::size_t stride,
                                bool points) const;
    void prepare_compliances(bool points) const;
    bool prepare_modes(bool points) const;
    bool can_respond(bool points) const;
    template <class Theirs, class Ours>
    void beside_twin(const Theirs& theirs, const Ours& ours) const;
    GradientChange about_base() const { return {*player_, effects_, *base_}; }
    bool factorise(const Hypothesis& h, const ExternalActions& actions, const Eigen::VectorXd& x,
                   Cholesky& factor) const;

    Case case_;
    PlayerSettings settings_;
    std::unique_ptr<ScenePlayer> player_;
    std::unique_ptr<Trajectory> twin_;
    std::size_t horizon_ = 0;
    std::vector<std::unique_ptr<Effect>> effects_;
    PartedBodies parted_;
    std::vector<ModelVariant> variants_;
    // Never null; a base's frames are made on first use. The twin may look at it as well.
    std::shared_ptr<BaseTrajectory> base_ = std::make_shared<BaseTrajectory>();
    // What base_ is compared with while it is an approximate one: the last of which every frame was solved, or rebased.
    std::shared_ptr<BaseTrajectory> whole_ = std::make_shared<BaseTrajectory>();
    std::shared_ptr<const BaseTrajectory> guide_;  // the last of which every frame was solved
    bool share_ = false;
    mutable std::unique_ptr<Cholesky> factor_;  // of tangents at bases
    mutable Eigen::MatrixXd modal_subspace_;    // of the last dynamic base
};

}  // namespace teres
