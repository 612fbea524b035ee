// One folder of a peer's recorded filter run in memory (scene.json, filter_settings.json and the tables they
// name). Plain data; scene_reader.h fills and checks it. SI units; steps count from 1, rows from 0.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/case/case.h"
#include "plugins/estimator/parameter_map.h"
#include "plugins/estimator/sigma_points.h"
#include "plugins/simulation/anchor_spring.h"
#include "plugins/simulation/implicit_step.h"

namespace teres::peer {

enum class SolidLaw { kCorotationalFirstEdge, kCorotationalPolar, kStvk };
enum class Integrator { kImplicitEuler, kImplicitMidpoint, kStatic };

/// Steps [first, last] in which something acts; last < 0: open.
struct StepRange {
    int first = 1;
    int last = -1;
    bool contains(int step) const { return step >= first && (last < 0 || step <= last); }
};

/// One of the two runs of a folder: the generator that made the observations, or the filter.
struct RunSettings {
    Integrator integrator = Integrator::kImplicitEuler;
    StaticOptions equilibrium;
    int cg_iterations = 0;  ///< of the implicit steps; 0: direct
    double cg_tolerance = 0.0;
    double dt_s = 0.0;
    double rayleigh_mass_1_s = 0.0;
    double rayleigh_stiffness_s = 0.0;
    double velocity_damping_1_s = 0.0;
    Eigen::Vector3d gravity_m_s2{0.0, 0.0, 0.0};
    int tool_row_offset = 0;               ///< at step k the tool stands at row k + offset
    std::vector<StepRange> tool_attached;  ///< empty: always
};

/// From `from_step` on, springs have another stiffness (a cut: 0).
struct Event {
    int from_step = 0;
    std::vector<std::size_t> springs;
    std::array<std::optional<double>, 3> k;
};

struct SpringTable {
    AnchorLaw law = AnchorLaw::kRestShape;
    std::vector<AnchorSpring> springs;  ///< with the true coefficients
    std::vector<std::string> group;     ///< per spring, empty if the table has no groups
    std::size_t num_coefficients = 1;   ///< per spring
};

struct Tool {
    std::vector<NodeIndex> nodes;
    double stiffness_n_per_m = 0.0;
    std::vector<Eigen::Matrix3Xd> rows;  ///< one column, or one per node
};

/// A force on a group of nodes, given by steps, by alternation between two groups, or by a table.
struct Load {
    std::vector<NodeIndex> nodes, other_nodes;
    Eigen::Vector3d force_n{0, 0, 0}, other_force_n{0, 0, 0};  ///< on each node
    std::vector<StepRange> steps;                              ///< empty: always
    int first_swap_after_steps = 0;                            ///< 0: no alternation
    int swap_every_steps = 0;
    std::vector<Eigen::Vector3d> rows;  ///< table of forces; empty: constant
    int row_offset = 0;
};

struct Recording {
    int first_record_step = 0;  ///< row 0 is this generator step
    int record_every_steps = 1;
    bool all_nodes = false;      ///< rows hold every node, not the observed points
    int significant_digits = 0;  ///< 0: full precision
    bool stored = false;
    double stored_dt_s = 0.0;
    std::vector<Eigen::VectorXd> rows;  ///< stored: 3 per point or per node
};

struct ObservedPoint {
    int id = 0;
    std::array<NodeIndex, 4> node{};
    std::array<double, 4> weight{};
};

/// What one estimated parameter changes in the model.
struct ParameterTarget {
    enum class Kind { kModulus, kSpring } kind = Kind::kModulus;
    std::vector<std::size_t> regions;  ///< kModulus: regions that share it
    std::vector<std::size_t> springs;  ///< kSpring: springs that share it
    std::size_t coefficient = 0;
};

enum class FilterKind { kRoUkf, kUkfParameters };

struct FilterSettings {
    FilterKind kind = FilterKind::kRoUkf;
    std::vector<std::string> names;
    std::vector<ParameterTarget> targets;
    std::vector<Transform> transform;
    Eigen::VectorXd mean, stdev, lower, upper;
    std::vector<double> filter_stdev;  ///< > 0: stated in filter coordinates
    double observation_stdev_m = 0.0;
    SigmaPointKind points = SigmaPointKind::kSimplex;
    double star_lambda = 1.0;
    bool unbiased_variance = false;
    bool velocities_in_state = false;
    Eigen::VectorXd process_noise_stdev;  ///< per step, filter coordinates; empty: none
};

struct Scene {
    std::filesystem::path folder;
    SolidLaw law = SolidLaw::kCorotationalFirstEdge;
    double poissons_ratio = 0.0;
    std::vector<std::string> modulus_names;  ///< empty: one modulus
    std::vector<double> modulus_pa;          ///< per region
    TetMeshData mesh;
    std::vector<std::size_t> region;  ///< per tetrahedron, index into modulus_pa
    Eigen::VectorXd node_mass_kg;
    std::vector<char> held;
    std::map<std::string, std::vector<NodeIndex>> groups;

    std::optional<SpringTable> springs;
    std::optional<Tool> tool;
    std::vector<Load> loads;
    RunSettings generator, filter_run;
    std::vector<Event> events;
    Recording recording;
    std::vector<ObservedPoint> points;

    int observation_row_offset = 0;  ///< filter step k uses row k + offset
    int compared_rows = 0;
    FilterSettings filter;

    std::vector<int> expected_step;  ///< per compared row
    Eigen::MatrixXd expected_state;  ///< compared rows x parameters, as recorded
    std::vector<std::string> warnings;

    /// True value of a parameter at a generator step (events included).
    double truth(std::size_t parameter, int step) const;
};

}  // namespace teres::peer
