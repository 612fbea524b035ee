// Plays the recording under a hypothesis: per frame the scene is made nominal, changed by the hypothesis'
// effects and brought to equilibrium (or stepped in time). One model, one lane.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "core/case/load_tracks.h"
#include "core/extensions/trajectory_model.h"
#include "plugins/simulation/effects/effect.h"

namespace teres {

struct PlayerSettings {
    CaseModelSettings model;
    double most_failed_share = 0.1;  ///< of the frames; a trajectory with more that do not converge is given up
    int most_failed_in_a_row = 2;    ///< ... or with more than these one after another
    int num_frames = 0;              ///< only so many from the first; 0: all
    bool soft_clamps = true;         ///< clamped nodes sit on a thin stiff layer instead of being held, so that
                                     ///< effects can move it or let it give way
};

class ScenePlayer {
  public:
    /// Errors: of CaseModel::make.
    static Result<std::unique_ptr<ScenePlayer>> make(const Case& c, const PlayerSettings& settings);

    Scene& scene() { return *scene_; }
    CaseModel& model() { return *model_; }
    const PlayerSettings& settings() const { return settings_; }
    const std::vector<double>& times() const { return times_; }
    /// Length of the step that ends at the frame.
    double step_s(std::size_t frame) const;

    struct KnownLoads {
        std::vector<double> region_force_n, tool_m;  ///< 3 per load region, 3 per tool
    };
    /// Makes the scene that of a time, under the hypothesis. `actions`: its resolved loads. Without `loads`: those of
    /// the recording.
    void enter(double t_s, const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
               ExternalActions& actions);
    void enter(double t_s, const KnownLoads& loads, const Hypothesis& h,
               const std::vector<std::unique_ptr<Effect>>& effects, ExternalActions& actions);

    struct StepResult {
        bool converged = false;
        double relative_residual = 0.0;
    };
    /// Equilibrium of one instant, recorded or not; x (3N) holds a start value and receives it. Of a quasi-static body
    /// under effects without memory.
    StepResult rest_at(double t_s, const KnownLoads& loads, const Hypothesis& h,
                       const std::vector<std::unique_ptr<Effect>>& effects, std::span<double> x);

    /// state: positions, then (dynamic) velocities and accelerations, 3 per node each.
    using Visitor = std::function<void(std::size_t frame, const double* state)>;
    using Guess = std::function<void(std::size_t frame, double* x)>;
    /// Plays all frames in order; `visit` sees those listed in `frames` (ascending; empty: all). guess(frame,
    /// x) may improve the start value of a quasi-static frame. A quasi-static body without memory skips other
    /// frames. horizon: frames from there on are left out; 0: none.
    /// subspace: of a dynamic body's motion; null: all of the mesh moves. all: given up at the first wanted frame that
    /// does not converge.
    TrajectoryReport play(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                          std::span<const std::int32_t> frames, const Visitor& visit, const Guess& guess = {},
                          std::size_t horizon = 0, SubspaceSolver* subspace = nullptr, bool all = false);
    /// play() as the markers see it: 3 per marker [m] at each of the listed frames; points_m: 3 per validation point or
    /// nothing.
    TrajectoryReport play_markers(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                                  std::span<const std::int32_t> frames, std::span<double> markers_m,
                                  std::span<double> points_m, const Guess& guess = {}, bool all = false);

  private:
    ScenePlayer() = default;
    StepResult step(double from_s, double to_s, const Hypothesis& h,
                    const std::vector<std::unique_ptr<Effect>>& effects);
    StepResult settle(double h, const ExternalActions& actions, const std::vector<double>& theta);
    /// settle() of one state under the scene that was entered; start and end may be the same.
    StepResult settle_from(std::span<const double> start, double h, std::span<const double> theta,
                           std::span<double> end);

    Case case_;
    PlayerSettings settings_;
    std::unique_ptr<CaseModel> model_;
    std::unique_ptr<Scene> scene_;
    KnownLoads loads_at(double t_s) const;
    std::unique_ptr<LoadTracks> tracks_;
    std::vector<KnownLoads> frame_loads_;
    std::vector<double> times_;
    ViscousMemory memory_;
    std::vector<double> state_;       // one lane: 3N positions, then velocities, accelerations
    std::vector<double> last_state_;  // before a guess was added; empty: none was
    std::vector<double> batch_;       // batch layout
    ExternalActions actions_;
};

}  // namespace teres
