// The mechanical model of one run of a folder (generator or filter): one step of one simulation with given
// parameters.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "plugins/simulation/implicit_step.h"
#include "tools/peer_bench/scene.h"

namespace teres::peer {

class PeerModel {
  public:
    /// Keeps a reference to the scene.
    static Result<PeerModel> make(const Scene& scene, const RunSettings& run);

    /// One thread's work space.
    struct Lane {
        explicit Lane(const PeerModel& model);
        Stepper stepper;
        std::vector<double> modulus;        // per tetrahedron
        std::vector<AnchorSpring> springs;  // tool springs last
        Eigen::VectorXd outer_force;
    };

    MotionState rest() const;
    /// Step k >= 1 with physical parameters theta (empty: the true values at that step). False: singular
    /// matrix.
    bool advance(int k, const Eigen::VectorXd& theta, Lane& lane, MotionState& state) const noexcept;
    /// Last step for which the tool and load tables have rows.
    int last_step() const;

    const TetSystem& system() const { return *system_; }
    const RunSettings& run() const { return *run_; }
    const Scene& scene() const { return *scene_; }
    /// Nodes that are not held, in order: the positions in a filter's state.
    const std::vector<NodeIndex>& free_nodes() const { return free_nodes_; }

  private:
    const Scene* scene_ = nullptr;
    const RunSettings* run_ = nullptr;
    std::unique_ptr<TetSystem> system_;
    std::vector<NodeIndex> free_nodes_;
};

/// Positions of the observed points: 3 per point.
Eigen::VectorXd observe(const std::vector<ObservedPoint>& points, const Eigen::VectorXd& x);

/// The recording as rows of observed points; runs the generator unless the rows are stored. Rows 0 ..
/// last_row.
Result<std::vector<Eigen::VectorXd>> observations(const Scene& scene, const PeerModel& generator, int last_row);

/// Row of the recording that filter step k looks at.
int observation_row(const Scene& scene, int k);

/// value rounded to `digits` significant decimal digits (as a text file with that precision would hold it).
double rounded(double value, int digits);

}  // namespace teres::peer
