// The forward model of a case: liver of the case folder, ligament groups as unknowns, markers and points as
// outputs. Offers teres.forward_model/1 and teres.topology/1. State: positions [m] (quasi-static), then velocities
// [m/s], then accelerations [m/s^2] (implicit Euler: 6N rows; generalised alpha: 9N rows).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/extensions/forward_model.h"
#include "core/extensions/topology.h"
#include "core/result.h"
#include "plugins/simulation/equilibrium.h"
#include "plugins/simulation/ligament.h"
#include "plugins/simulation/time_step.h"

namespace teres {

struct CaseModelSettings {
    ElementType element = ElementType::kNodalBlend;
    double shear_blend = 0.5;
    bool separate_parts = false;         ///< shear and volume on strain points of their own, for effects
    std::string law = "case";            ///< case, stvk, corotational, neo_hookean, ogden
    std::string boundary = "estimated";  ///< estimated, atlas_fixed, known
    double fixed_probability = 0.5;      ///< atlas_fixed holds nodes at or above this probability
    LigamentSettings ligament;
    EquilibriumSettings equilibrium;
    std::string integrator = "auto";  ///< auto (of the case), quasi_static, implicit_euler, generalised_alpha
    double spectral_radius = 0.9;     ///< of generalised alpha at infinite frequency
    double max_step_s = 0.0025;       ///< of dynamic cases; frames further apart are walked in parts
    int max_lanes = 40;
    int threads = 2;  ///< that share a step; results depend on it in the last bits
};

class CaseModel final : public ForwardModel, public Topology {
  public:
    /// Errors (kInvalidInput): material out of range, nothing holds the body (no clamp, ligament, spring or
    /// tool).
    static Result<std::unique_ptr<CaseModel>> make(const Case& c, const CaseModelSettings& settings);

    std::size_t num_nodes() const override { return system_->num_nodes(); }
    std::size_t num_state() const override;
    std::size_t num_parameters() const override { return parameters_.size(); }
    ForwardParameter parameter(std::size_t index) const override;
    std::size_t num_attachment_nodes() const override { return attachment_.size(); }
    AttachmentNode attachment_node(std::size_t index) const override { return attachment_[index]; }
    std::size_t num_regions() const override { return region_names_.size(); }
    const char* region_name(std::size_t index) const override { return region_names_[index].c_str(); }
    std::size_t num_tools() const override { return tool_names_.size(); }
    const char* tool_name(std::size_t index) const override { return tool_names_[index].c_str(); }
    std::size_t num_markers() const override { return markers_.size(); }
    std::int32_t marker_id(std::size_t index) const override { return marker_ids_[index]; }
    std::size_t num_points() const override { return points_.size(); }
    std::int32_t point_id(std::size_t index) const override { return point_ids_[index]; }
    void rest_state(std::span<double> x) const override;
    ForwardReport advance(const ForwardInputs& inputs, std::span<const double> theta, std::span<double> X,
                          std::size_t lanes) noexcept override;
    void observe(std::span<const double> X, std::span<double> Z, std::size_t lanes) const noexcept override;
    void predict_points(std::span<const double> x, std::span<double> out) const noexcept override;

    CutReport cut(std::span<const std::int32_t> tets, std::span<const std::int32_t> parameters) noexcept override;
    bool marker_lost(std::size_t index) const noexcept override { return marker_lost_[index] != 0; }

    const TetMesh& mesh() const { return mesh_; }
    const MechanicalSystem& system() const { return *system_; }
    MechanicalSystem& system() { return *system_; }
    const EquilibriumSolver& solver() const { return *solver_; }
    EquilibriumSolver& solver() { return *solver_; }
    TimeStepper& stepper() { return *stepper_; }
    const std::vector<SurfaceRider>& markers() const { return markers_; }
    const std::vector<Embedding>& points() const { return points_; }
    const Ligament& ligament() const { return ligament_; }
    TimeScheme scheme() const { return scheme_; }

  private:
    struct Parameter {
        std::string name, unit;
        double prior_median = 1.0, prior_log_stdev = 0.0, lower = 0.0, upper = 0.0, threshold = 0.0;
    };
    CaseModel() = default;
    void add_springs(const Case& c, MechanicalSystem::Parts& parts);
    void predict(double time_s, std::size_t lanes, std::size_t stride) noexcept;
    void rest_bare_nodes(std::size_t stride) noexcept;
    void remember(double time_s, std::span<const double> start, std::size_t lanes, std::size_t stride) noexcept;

    TetMesh mesh_;
    Ligament ligament_;
    std::unique_ptr<MechanicalSystem> system_;
    std::unique_ptr<EquilibriumSolver> solver_;
    std::unique_ptr<TimeStepper> stepper_;
    TimeScheme scheme_ = TimeScheme::kQuasiStatic;
    std::size_t max_lanes_ = 1;
    std::vector<Parameter> parameters_;
    std::vector<AttachmentNode> attachment_;
    std::vector<std::string> region_names_, tool_names_;
    std::vector<SurfaceRider> markers_;
    std::vector<std::int32_t> marker_ids_, point_ids_;
    bool can_be_cut_ = false;
    std::vector<char> marker_lost_;
    std::vector<Embedding> points_;
    ExternalActions actions_;
    std::vector<double> x_, theta_;  // batch layout
    std::vector<double> motion_;     // mean of the lanes over the last step [m], and when that was
    double motion_time_s_ = 0.0, motion_dt_s_ = 0.0;
    std::vector<double> motion_before_;  // that of the step before
    double motion_before_dt_s_ = 0.0;
    std::size_t motion_lanes_ = 0;
};

}  // namespace teres
