// A whole recording simulated under a hypothesis, and its first-order response to other hypotheses: what the gap
// diagnosis asks of the mechanics. Offline: calls may take seconds; they report progress and can be cancelled.
//
// Layout of outputs: markers of frame f at f * 3 M + 3 m + a; points likewise. Frames are those of the recording.
#pragma once

#include "core/extensions/effects.h"

namespace teres {

/// Nominal parameters (ligament groups, physical values, order of TrajectoryModel::parameter) and effects switched on.
struct Hypothesis {
    std::span<const double> theta;
    std::span<const EffectInstance> effects;
};

struct TrajectoryReport {
    std::int32_t frames = 0;
    std::int32_t frames_converged = 0;
    double relative_residual = 0.0;  ///< largest
};

struct NominalParameter {
    const char* name;
    const char* unit;
    double prior_log_mean, prior_log_stdev;  ///< of ln(theta)
    double lower, upper;
};

class TrajectoryModel : public EffectCatalogue {
  public:
    static constexpr const char* kId = "teres.trajectory_model/8";

    virtual std::size_t num_parameters() const noexcept = 0;
    virtual NominalParameter parameter(std::size_t index) const noexcept = 0;
    virtual std::size_t num_frames() const noexcept = 0;
    virtual double time_s(std::size_t frame) const noexcept = 0;
    /// The body has inertia: a frame follows from those before it, and every frame is played.
    virtual bool dynamic() const noexcept { return false; }
    /// Until the next call only so many frames from the first are simulated, later ones repeat the last of them and do
    /// not respond at first order; 0: all. For trial fits of a beginning; models without inertia may ignore it.
    virtual void set_horizon(std::size_t) noexcept {}
    virtual std::size_t num_markers() const noexcept = 0;
    virtual std::int32_t marker_id(std::size_t index) const noexcept = 0;
    virtual std::size_t num_points() const noexcept = 0;  ///< validation points: only ever predicted
    virtual std::int32_t point_id(std::size_t index) const noexcept = 0;

    /// Surface of the nominal mesh for maps and pictures.
    virtual std::size_t num_nodes() const noexcept = 0;
    virtual void rest_positions(std::span<double> x_m) const noexcept = 0;  ///< 3 per node
    virtual std::size_t num_surface_triangles() const noexcept = 0;
    virtual void surface_triangles(std::span<std::int32_t> node) const noexcept = 0;  ///< 3 per triangle

    /// Of the stiffness by which ligaments are expected to hold the body (prior medians), the share at each node: their
    /// sum is 1. False: there are none.
    virtual bool ligament_shares(std::span<double> /*of_node*/) const noexcept { return false; }

    /// Moves values of an effect to what they stand for: a place on the surface to the surface's nearest point.
    virtual void settle_effect(std::size_t /*effect*/, std::span<double> /*values*/) const noexcept {}

    /// Simulates the recording under `h`. Empty outputs are not written. nodes: positions of all nodes,
    /// f * 3 N + 3 i + a. The trajectory is kept as the base of first_order().
    virtual TrajectoryReport simulate(const Hypothesis& h, std::span<double> markers_m, std::span<double> points_m,
                                      std::span<double> nodes_m) noexcept = 0;

    /// simulate() at a fraction of its cost where the recording allows it: only frames between which the change from
    /// the last simulate() or rebase() does not follow from its first order are solved; between them the rest of the
    /// change is interpolated in time.
    virtual TrajectoryReport approximate(const Hypothesis& h, std::span<double> markers_m) noexcept {
        return simulate(h, markers_m, {}, {});
    }
    /// The last approximate() takes the place of the last simulate() for those that follow, with tangents of its own at
    /// frames that it solved. Frames between them keep the error of their interpolation.
    virtual void rebase() noexcept {}

    /// simulate() at the given frames only (ascending); markers_m has 3 M per listed frame. The base stays what it is.
    /// Without inertia it ends at the first frame that does not converge.
    virtual TrajectoryReport simulate_at(const Hypothesis& h, std::span<const std::int32_t> frames,
                                         std::span<double> markers_m) noexcept = 0;

    /// First-order response of markers (and points if not empty) when hypothesis `base` (that of the last simulate() or
    /// approximate()) is replaced by each of `others`: quasi-static, per frame  K(x; base) dx = -dg, dg the derivative
    /// of the gradient g(x; .) from `base` towards `other` along the transformed parameters (ln theta; amplitudes from
    /// their null value where `base` has not the effect). Column k of the output (3 M F rows each) is the change of the
    /// marker trajectory.
    virtual bool first_order(std::span<const Hypothesis> others, std::span<double> markers_m,
                             std::span<double> points_m) noexcept = 0;

    /// Response of markers to a unit force [m/N] on a node, per frame, at the last trajectory: out[(f * 3 M + r) * 3 +
    /// b] for marker row r and force direction b.
    virtual bool marker_compliance(std::int32_t node, std::span<double> out) const noexcept = 0;

    /// What effect `which` of the last trajectory's hypothesis does to each node [N]: rms over frames of the change of
    /// its force when the effect is taken away while the body stays where it is. False: it cannot be told.
    virtual bool effect_forces(std::size_t /*which*/, std::span<double> /*rms_n*/) const noexcept { return false; }

    /// Other models of the same nominal body (finer discretisation, other laws): their difference from the nominal one
    /// is what may not be blamed on the patient.
    virtual std::size_t num_variants() const noexcept = 0;
    virtual const char* variant_name(std::size_t index) const noexcept = 0;
    /// Standard deviation of what the variant changes, in such changes.
    virtual double variant_share(std::size_t /*index*/) const noexcept { return 1.0; }
    /// Simulates variant `index` at the given frames only (ascending), from where the body was at them at the last
    /// simulate(); markers_m has 3 M per listed frame, points_m 3 P or nothing, NaN at those of a quasi-static
    /// recording that do not converge. Several threads may ask at once.
    virtual TrajectoryReport simulate_variant(std::size_t index, const Hypothesis& h,
                                              std::span<const std::int32_t> frames, std::span<double> markers_m,
                                              std::span<double> points_m) noexcept = 0;

    /// The same recording by a model with a state of its own, so that another thread can ask it: made on the first
    /// call, owned by this one, which must outlive its use. Null: there is none.
    virtual TrajectoryModel* twin() noexcept { return nullptr; }
    /// While on, calls of this model may take a share of their work to the twin: nobody else asks that meanwhile. Off
    /// at the beginning. A trajectory then differs within the residual at which its frames end.
    virtual void share_with_twin(bool /*on*/) noexcept {}

  protected:
    ~TrajectoryModel() = default;
};

/// What the sensors make of true marker trajectories (sensor effects of the catalogue). Layout as above.
class ObservationModel : public EffectCatalogue {
  public:
    static constexpr const char* kId = "teres.observation_model/1";

    /// observed = true positions as seen with the effects switched on; time_s has one entry per frame.
    virtual void observe(std::span<const EffectInstance> effects, std::span<const double> time_s,
                         std::span<const double> markers_true_m,
                         std::span<double> markers_observed_m) const noexcept = 0;
    /// Factor on the stated noise of every marker (the effect `noise`); 1 without it.
    virtual double noise_factor(std::span<const EffectInstance> effects) const noexcept = 0;

  protected:
    ~ObservationModel() = default;
};

}  // namespace teres
