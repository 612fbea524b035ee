// A body that is parted across a plane from some instant on: faces of its mesh open and their nodes are doubled.
//
//     a face opens where its two tetrahedra lie on different sides of (x - c) . n = 0, by their centroids, and its own
//     centroid lies within r of c
//
// A node becomes as many as there are groups of tetrahedra about it that still hang together by faces.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/case/case.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

struct PartedMesh {
    TetMeshData mesh;                  ///< the nodes of the whole one first
    std::vector<std::int32_t> origin;  ///< of each node, its node in the whole mesh
    std::vector<double> opened_m2;     ///< per node of the whole mesh: its third of the opened faces
};

/// Nothing if no face opens or the body would fall into more pieces than before. A tetrahedron that would hang by
/// nothing counts as on the other side.
std::optional<PartedMesh> part(const TetMeshData& mesh, const Crack& crack);

/// A quasi-static recording of a body that is parted throughout.
class PartedBody {
  public:
    /// Null: see part(), or no model can be made of it.
    static std::unique_ptr<PartedBody> make(const Case& whole, const PlayerSettings& settings, const Crack& crack);

    const Crack& crack() const { return crack_; }
    const PartedMesh& mesh() const { return mesh_; }
    /// The case of the parted body.
    const Case& data() const { return case_; }

    /// The listed frames (ascending) of the recording. whole: where the nodes of the whole body are at all frames under
    /// the same hypothesis, or nothing: each frame begins where that moves from the one before. markers_m: 3 per marker
    /// [m] at each listed frame; points_m, nodes_m (of the whole mesh): likewise, or nothing. all: given up at the
    /// first that does not converge.
    TrajectoryReport play(const Hypothesis& h, const std::vector<std::unique_ptr<Effect>>& effects,
                          std::span<const std::int32_t> frames, std::span<const Eigen::VectorXd> whole,
                          std::span<double> markers_m, std::span<double> points_m, std::span<double> nodes_m, bool all);

    /// Positions of the whole body's nodes given to all of this one's.
    Eigen::VectorXd doubled(const Eigen::VectorXd& whole) const;
    std::vector<Eigen::VectorXd> doubled(std::span<const Eigen::VectorXd> whole) const;

  private:
    PartedBody() = default;

    Crack crack_;
    PartedMesh mesh_;
    Case case_;
    std::unique_ptr<ScenePlayer> player_;
};

/// The body of a case as cracks part it; the one that was asked for last is kept.
class PartedBodies {
  public:
    /// Null: see PartedBody::make().
    PartedBody* by(const Case& whole, const PlayerSettings& settings, const Crack& crack);

  private:
    std::optional<Crack> asked_;
    std::unique_ptr<PartedBody> body_;
};

/// How the hypothesis parts the body; nothing if it does not.
std::optional<Crack> crack_of(const std::vector<std::unique_ptr<Effect>>& effects, const Hypothesis& h);

/// First of the frames at which the body is parted.
std::size_t first_parted(const std::vector<double>& times_s, const Crack& crack);

/// Plays the listed frames into 3 numbers per marker and per point (or no points), in the same order.
using FramePlayer = std::function<TrajectoryReport(std::span<const std::int32_t> frames, std::span<double> markers_m,
                                                   std::span<double> points_m)>;
/// The listed frames (ascending) before `first` by `whole`, the others by `parted`; what has no frame is not called.
TrajectoryReport play_in_two(std::span<const std::int32_t> frames, std::size_t first, std::span<double> markers_m,
                             std::span<double> points_m, const FramePlayer& whole, const FramePlayer& parted);

/// Of both.
TrajectoryReport both(const TrajectoryReport& a, const TrajectoryReport& b);
/// None of so many frames converged.
TrajectoryReport none_of(std::size_t frames);

}  // namespace teres
