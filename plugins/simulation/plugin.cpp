// Unit `simulation`: reads the case, offers teres.forward_model/1, teres.topology/1 (not with effects as unknowns) and,
// if asked, teres.trajectory_model. It has no messages of its own; whoever estimates or simulates calls the interface
// and publishes.
#include "core/plugin_sdk.h"

#include "core/case/case_reader.h"
#include "plugins/simulation/case_model.h"
#include "plugins/simulation/effect_model.h"
#include "plugins/simulation/settings.h"
#include "plugins/simulation/trajectory.h"

namespace teres {

class SimulationPlugin final : public Unit {
  public:
    using Settings = SimulationSettings;
    Settings settings;

    explicit SimulationPlugin(Host host) : host_(std::move(host)) {}

    Status configure() override {
        if (settings.case_folder.empty())
            return invalid_input("simulation.case (or service.case) names no case folder");
        CaseReadOptions options;
        options.observations = settings.trajectories;  // their times
        TERES_TRY_ASSIGN(const Case c, read_case(settings.case_folder, options));
        TERES_TRY(make_model(c));
        host_.log(TERES_LOG_INFO, "simulation",
                  c.name + ": " + std::to_string(c.mesh.tets.size()) + " tetrahedra, " +
                      std::to_string(c.mesh.nodes.size()) + " nodes, " + std::to_string(forward_->num_parameters()) +
                      " unknowns");
        if (settings.trajectories) {
            TERES_TRY_ASSIGN(trajectory_, Trajectory::make(c, settings.player_settings()));
        }
        return {};
    }
    teres_step_outcome step(std::int64_t) noexcept override { return TERES_STEP_IDLE; }
    void* extension(std::string_view id) override {
        if (id == ForwardModel::kId) return forward_;
        if (id == Topology::kId && model_) return static_cast<Topology*>(model_.get());
        if (id == TrajectoryModel::kId && trajectory_) return static_cast<TrajectoryModel*>(trajectory_.get());
        return nullptr;
    }

  private:
    Status make_model(const Case& c) {
        const std::vector<std::string> ids = settings.effect_ids();
        if (ids.empty()) {
            TERES_TRY_ASSIGN(model_, CaseModel::make(c, settings.model_settings()));
            forward_ = model_.get();
        } else {
            PlayerSettings player;
            player.model = settings.model_settings();
            TERES_TRY_ASSIGN(with_effects_, EffectModel::make(c, player, ids));
            forward_ = with_effects_.get();
        }
        return {};
    }

    Host host_;
    std::unique_ptr<CaseModel> model_;
    std::unique_ptr<EffectModel> with_effects_;
    ForwardModel* forward_ = nullptr;
    std::unique_ptr<Trajectory> trajectory_;
};

}  // namespace teres

TERES_PLUGIN(teres::SimulationPlugin, "simulation", "tetrahedral liver held by ligaments", TERES_UNIT_PLUGIN)
