// The forward model as other units see it: all sigma points of a filter advanced at once over one mesh.
// Crosses a plugin boundary: spans of doubles, plain structs, no exceptions, no ownership.
//
// Columns are lanes (one simulation each), stored one after the other (column-major): state X is num_state x lanes,
// parameters theta is num_parameters x lanes. A single simulation is a batch of one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace teres {

/// What is known to act during a step.
struct ForwardInputs {
    double time_s = 0.0;                      ///< end of the step
    double dt_s = 0.0;                        ///< length of the step (dynamic); ignored when quasi-static
    std::span<const double> region_force_n;   ///< 3 per load region, in the order of region_name()
    std::span<const double> tool_position_m;  ///< 3 per tool, in the order of tool_name(); NaN: detached
};

struct ForwardReport {
    std::int32_t lanes = 0;
    std::int32_t lanes_converged = 0;  ///< met the residual criterion
    std::int32_t iterations = 0;       ///< of the slowest lane
    std::int32_t factorisations = 0;   ///< done in this call
    double relative_residual = 0.0;    ///< largest over lanes: |r| / reference force
};

/// A parameter theta[i] in physical units, with the model's prior knowledge of it.
struct ForwardParameter {
    const char* name;  ///< e.g. "ligament.r3.stiffness"; valid while the model lives
    const char* unit;  ///< e.g. "N/m"
    double prior_median;
    double prior_log_stdev;  ///< > 0: prior is log-normal with this standard deviation of ln(theta); 0: see prior_stdev
    double prior_stdev;      ///< used when prior_log_stdev is 0
    double lower, upper;     ///< physical bounds (may be infinite)
    double attachment_threshold;  ///< theta above this counts as attached; 0: not a ligament parameter
};

/// A surface node of the prior ligament region.
struct AttachmentNode {
    std::int32_t node_id;
    std::int32_t parameter;    ///< index of the parameter (group) that this node's stiffness follows
    double prior_probability;  ///< of the atlas
};

class ForwardModel {
  public:
    static constexpr const char* kId = "teres.forward_model/1";

    // Shape [setup]
    virtual std::size_t num_nodes() const = 0;
    virtual std::size_t num_state()
        const = 0;  ///< 3 N (positions) quasi-static; then velocities and, by scheme, accelerations: 6 N or 9 N
    virtual std::size_t num_parameters() const = 0;
    virtual ForwardParameter parameter(std::size_t index) const = 0;
    virtual std::size_t num_attachment_nodes() const = 0;
    virtual AttachmentNode attachment_node(std::size_t index) const = 0;
    virtual std::size_t num_regions() const = 0;
    virtual const char* region_name(std::size_t index) const = 0;
    virtual std::size_t num_tools() const = 0;
    virtual const char* tool_name(std::size_t index) const = 0;
    virtual std::size_t num_markers() const = 0;  ///< markers that observe() returns, in case order
    virtual std::int32_t marker_id(std::size_t index) const = 0;
    virtual std::size_t num_points() const = 0;  ///< validation points, in case order
    virtual std::int32_t point_id(std::size_t index) const = 0;
    virtual void rest_state(std::span<double> x) const = 0;

    // [loop]
    /// Advances every lane in place: X (num_state x lanes) holds the start of the step (quasi-static: a start value)
    /// and receives its end. theta: num_parameters x lanes, physical. A lane that did not converge keeps its best
    /// iterate.
    virtual ForwardReport advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                                  std::size_t lanes) noexcept = 0;
    /// Marker positions of every lane: Z is (3 num_markers) x lanes [m].
    virtual void observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept = 0;
    /// Validation point positions of one state: out is 3 num_points [m].
    virtual void predict_points(std::span<const double> x, std::span<double> out) const noexcept = 0;

  protected:
    ~ForwardModel() = default;
};

}  // namespace teres
