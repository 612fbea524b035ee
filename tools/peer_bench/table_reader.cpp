// The tables of a folder: mesh and node groups, springs, tool, loads, observed points, observations, expected
// rows.
#include <fmt/format.h>

#include <cmath>

#include "core/case/case_reader.h"
#include "core/case/text_file.h"
#include "tools/peer_bench/scene_reader.h"
#include "tools/peer_bench/table.h"

namespace teres::peer {

namespace {

constexpr double kHuge = 1e300;

Eigen::Vector3d node_position(const Scene& scene, NodeIndex node) {
    const auto& p = scene.mesh.nodes[static_cast<std::size_t>(node)];
    return {p[0], p[1], p[2]};
}

Result<std::array<std::size_t, 3>> xyz_columns(const Table& table, const std::string& prefix) {
    std::array<std::size_t, 3> out{};
    const char* axes[] = {"x", "y", "z"};
    for (std::size_t i = 0; i < 3; ++i) {
        TERES_TRY_ASSIGN(out[i], table.column({prefix + axes[i], prefix + axes[i] + "_m"}));
    }
    return out;
}

// Columns of a spring coefficient. One that only holds after an event ("..._after_cut") is not it.
Result<std::size_t> coefficient_column(const Table& table, const std::vector<std::string>& tokens) {
    std::vector<std::size_t> found;
    for (std::size_t c = 0; c < table.columns().size(); ++c) {
        std::string name = "_" + table.columns()[c] + "_";
        for (char& letter : name) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
        if (name.find("_after") != std::string::npos) continue;
        for (const auto& token : tokens)
            if (name.find("_" + token + "_") != std::string::npos) {
                found.push_back(c);
                break;
            }
    }
    if (found.size() == 1) return found.front();
    std::string list;
    for (const auto& name : table.columns()) list += (list.empty() ? "" : ", ") + name;
    return invalid_input(table.name() + ":1: " + (found.empty() ? "no column" : "more than one column") +
                         " with the coefficient '" + tokens.front() + "' among " + list);
}

std::vector<std::string> lower_axes(const Table& table) {
    // x,y,z or x0,y0,z0,x1,... or p0_x,p0_y,...: every column but the time and step ones.
    std::vector<std::string> out;
    for (const auto& name : table.columns()) {
        const std::string key = plain(name);
        if (key != "time" && key != "times" && key != "ts" && key != "t" && key != "step" && key != "row")
            out.push_back(name);
    }
    return out;
}

}  // namespace

Status read_mesh_and_groups(Scene& scene) {
    TERES_TRY_ASSIGN(scene.mesh, read_vtk_tets(scene.folder / "mesh.vtk", true));
    const auto file = scene.folder / "nodes.csv";
    if (!std::filesystem::exists(file)) return {};
    TERES_TRY_ASSIGN(const Table table, Table::read(file, {"group"}));
    TERES_TRY_ASSIGN(const std::size_t group, table.column({"group"}));
    TERES_TRY_ASSIGN(const std::size_t node, table.column({"node", "node_id"}));
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        TERES_TRY_ASSIGN(const auto id, table.index(row, node, scene.mesh.nodes.size()));
        scene.groups[table.text(row, group)].push_back(id);
        if (!table.find("x")) continue;
        TERES_TRY_ASSIGN(const auto xyz, xyz_columns(table, ""));
        const Eigen::Vector3d p(table.number(row, xyz[0]), table.number(row, xyz[1]), table.number(row, xyz[2]));
        const double gap = (p - node_position(scene, id)).norm();
        if (gap > 1e-6)
            return invalid_input(table.place(row) + ": node " + std::to_string(id) + " stands " + to_text(gap) +
                                 " m from its place in mesh.vtk (bound 1e-6 m)");
    }
    return {};
}

Status read_springs(const JsonObject& object, Scene& scene) {
    SpringTable springs;
    TERES_TRY_ASSIGN(const std::string text, object.text({"law", "type"}));
    const std::string law = plain(text);
    const bool polynomial = law.find("polynomial") != std::string::npos, rest = law.find("rest") != std::string::npos;
    if (polynomial && rest)
        springs.law = AnchorLaw::kPolynomialRestShape;
    else if (polynomial)
        springs.law = AnchorLaw::kPolynomialTension;
    else if (law.find("cubic") != std::string::npos)
        springs.law = AnchorLaw::kCubicTension;
    else if (rest || law.find("linear") != std::string::npos)
        springs.law = AnchorLaw::kRestShape;
    else
        return object.error({"law", "type"},
                            in_quotes(text) +
                                " is not rest_shape_linear, polynomial_tension, polynomial_rest_shape or "
                                "cubic_tension");
    TERES_TRY_ASSIGN(const std::string file, object.text({"table"}));
    TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / file, {"group", "parameter", "law", "name"}));
    TERES_TRY_ASSIGN(const std::size_t node, table.column({"node", "node_id"}));
    TERES_TRY_ASSIGN(const auto anchor, xyz_columns(table, "anchor_"));
    std::vector<std::size_t> k;
    if (springs.law == AnchorLaw::kRestShape) {
        TERES_TRY_ASSIGN(k.emplace_back(), coefficient_column(table, {"k", "stiffness", "k0", "k1"}));
    } else if (springs.law == AnchorLaw::kCubicTension) {
        for (const char* name : {"ka", "kb", "kg"}) {
            TERES_TRY_ASSIGN(k.emplace_back(), coefficient_column(table, {name}));
        }
    } else {
        for (const auto& name : {std::vector<std::string>{"a1"}, {"a2"}, {"a3"}}) {
            if (!k.empty() && !coefficient_column(table, name)) break;  // a lower degree
            TERES_TRY_ASSIGN(k.emplace_back(), coefficient_column(table, name));
        }
    }
    springs.num_coefficients = k.size();
    std::optional<std::size_t> rest_length;
    if (springs.law != AnchorLaw::kRestShape) {
        TERES_TRY_ASSIGN(rest_length, table.column({"rest_length_m", "rest_length", "initial_length_m", "l0_m"}));
    }
    AnchorSpring spring;
    spring.law = springs.law;
    spring.stiff_when_slack = springs.law == AnchorLaw::kPolynomialTension;
    spring.diagonal_stiffness = springs.law == AnchorLaw::kPolynomialRestShape;
    if (springs.law == AnchorLaw::kPolynomialRestShape) {
        TERES_TRY_ASSIGN(spring.smooth_shift, object.number({"smooth_shift"}, -kHuge, kHuge));
        TERES_TRY_ASSIGN(spring.smooth_scale, object.number({"smooth_scale"}, 0.0, kHuge));
    }
    TERES_TRY_ASSIGN(const bool compressible, object.boolean_or({"compressible"}, false));
    if (compressible) return object.error({"compressible"}, "true is not supported: the springs are slack when short");
    auto group = table.find("parameter");
    if (!group) group = table.find("group");
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        TERES_TRY_ASSIGN(spring.node, table.index(row, node, scene.mesh.nodes.size()));
        for (std::size_t i = 0; i < 3; ++i) spring.anchor(static_cast<Eigen::Index>(i)) = table.number(row, anchor[i]);
        for (std::size_t i = 0; i < k.size(); ++i) spring.k[i] = table.number(row, k[i]);
        if (rest_length) {
            spring.rest_length = table.number(row, *rest_length);
            if (!(spring.rest_length > 0.0))
                return invalid_input(table.place(row) + ": " + table.columns()[*rest_length] + " " +
                                     to_text(spring.rest_length) + " is not above 0");
        }
        springs.springs.push_back(spring);
        if (group) springs.group.push_back(table.text(row, *group));
    }
    object.report_unknown(scene.warnings);
    scene.springs = std::move(springs);
    return {};
}

Status read_tool(const JsonObject& object, Scene& scene) {
    Tool tool;
    TERES_TRY_ASSIGN(tool.nodes, nodes_of(scene, object, {"group", "groups"}));
    TERES_TRY_ASSIGN(tool.stiffness_n_per_m, object.number({"stiffness_n_per_m", "stiffness", "k"}, 0.0, kHuge));
    TERES_TRY_ASSIGN(const std::string file, object.text({"trajectory", "table"}));
    TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / file));
    const auto columns = lower_axes(table);
    const std::size_t points = columns.size() / 3;
    if (columns.size() % 3 != 0 || (points != 1 && points != tool.nodes.size()))
        return invalid_input(table.name() + ":1: " + std::to_string(columns.size()) +
                             " coordinate columns, expected 3 or 3 for each of " + std::to_string(tool.nodes.size()) +
                             " nodes");
    if (points == 1 && tool.nodes.size() > 1)
        scene.warnings.push_back(object.where() + ": all " + std::to_string(tool.nodes.size()) +
                                 " nodes of the tool are tied to the one point of " + file);
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        Eigen::Matrix3Xd at(3, static_cast<Eigen::Index>(points));
        for (std::size_t c = 0; c < columns.size(); ++c)
            at(static_cast<Eigen::Index>(c)) = table.number(row, *table.find(columns[c]));
        tool.rows.push_back(std::move(at));
    }
    object.report_unknown(scene.warnings);
    scene.tool = std::move(tool);
    return {};
}

Status read_load(const JsonObject& object, Scene& scene) {
    Load load;
    const JsonObject::Keys group = {"first", "group", "groups", "nodes"};
    TERES_TRY_ASSIGN(load.nodes, nodes_of(scene, object, group));
    // The force on each node: a vector, or a size along a direction; a total is shared by the nodes of the
    // group.
    const JsonObject::Keys each = {"force_n", "force", "force_per_node_n"}, total = {"total_force_n"};
    const auto force = [&](JsonObject::Keys direction, std::size_t nodes) -> Result<Eigen::Vector3d> {
        const bool shared = object.has(total);
        const JsonObject::Keys keys = shared ? total : each;
        const Json* value = object.find(keys);
        const double share = shared ? 1.0 / static_cast<double>(nodes) : 1.0;
        if (value != nullptr && value->is_array()) {
            TERES_TRY_ASSIGN(const Eigen::Vector3d vector, object.vector3(keys));
            return Eigen::Vector3d(share * vector);
        }
        TERES_TRY_ASSIGN(const double size, object.number(keys, -kHuge, kHuge));
        TERES_TRY_ASSIGN(const Eigen::Vector3d along, object.vector3(direction));
        return Eigen::Vector3d(share * size * along);
    };
    if (object.has({"table"})) {
        TERES_TRY_ASSIGN(const std::string file, object.text({"table"}));
        TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / file));
        const auto columns = lower_axes(table);
        if (columns.size() != 3)
            return invalid_input(table.name() + ":1: " + std::to_string(columns.size()) + " force columns, expected 3");
        for (std::size_t row = 0; row < table.num_rows(); ++row)
            load.rows.emplace_back(table.number(row, *table.find(columns[0])),
                                   table.number(row, *table.find(columns[1])),
                                   table.number(row, *table.find(columns[2])));
        TERES_TRY_ASSIGN(load.row_offset, object.row_offset({"row"}));
    } else {
        TERES_TRY_ASSIGN(load.force_n, force({"direction_first", "direction"}, load.nodes.size()));
    }
    if (object.has({"other"})) {
        TERES_TRY_ASSIGN(load.other_nodes, nodes_of(scene, object, {"other"}));
        TERES_TRY_ASSIGN(load.other_force_n, force({"direction_other"}, load.other_nodes.size()));
        TERES_TRY_ASSIGN(load.first_swap_after_steps, object.integer({"first_swap_after_steps"}, 1, 1000000000));
        TERES_TRY_ASSIGN(load.swap_every_steps, object.integer({"swap_every_steps"}, 1, 1000000000));
    }
    TERES_TRY_ASSIGN(load.steps, object.step_ranges({"steps"}));
    object.report_unknown(scene.warnings);
    scene.loads.push_back(std::move(load));
    return {};
}

Status read_points(Scene& scene) {
    TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / "obs_points.csv"));
    TERES_TRY_ASSIGN(const std::size_t id, table.column({"obs_id", "point_id", "id"}));
    std::array<std::size_t, 4> node{}, weight{};
    for (std::size_t i = 0; i < 4; ++i) {
        TERES_TRY_ASSIGN(node[i], table.column({fmt::format("node{}", i), fmt::format("n{}", i)}));
        TERES_TRY_ASSIGN(weight[i], table.column({fmt::format("b{}", i), fmt::format("w{}", i)}));
    }
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        ObservedPoint point;
        point.id = static_cast<int>(table.number(row, id));
        double sum = 0.0;
        for (std::size_t i = 0; i < 4; ++i) {
            TERES_TRY_ASSIGN(point.node[i], table.index(row, node[i], scene.mesh.nodes.size()));
            point.weight[i] = table.number(row, weight[i]);
            sum += point.weight[i];
        }
        if (!(std::abs(sum - 1.0) < 1e-6))
            return invalid_input(table.place(row) + ": weights sum to " + to_text(sum) + ", not to 1");
        scene.points.push_back(point);
    }
    if (scene.points.empty()) return invalid_input(table.name() + ": no points");
    return {};
}

Status read_stored_observations(const std::string& file, Scene& scene) {
    TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / file));
    const auto columns = lower_axes(table);
    const std::size_t points = 3 * scene.points.size(), nodes = 3 * scene.mesh.nodes.size();
    if (columns.size() != points && columns.size() != nodes)
        return invalid_input(table.name() + ":1: " + std::to_string(columns.size()) + " coordinate columns, expected " +
                             std::to_string(points) + " (points) or " + std::to_string(nodes) + " (nodes)");
    Recording& recording = scene.recording;
    recording.stored = true;
    recording.all_nodes = columns.size() != points;
    const std::size_t first = *table.find(columns.front());
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        Eigen::VectorXd values(static_cast<Eigen::Index>(columns.size()));
        for (std::size_t c = 0; c < columns.size(); ++c)
            values(static_cast<Eigen::Index>(c)) = table.number(row, first + c);
        recording.rows.push_back(std::move(values));
    }
    if (const auto time = table.find("time"); time && table.num_rows() > 1) {
        recording.stored_dt_s = (table.number(table.num_rows() - 1, *time) - table.number(0, *time)) /
                                static_cast<double>(table.num_rows() - 1);
        if (!(recording.stored_dt_s > 0.0)) return invalid_input(table.name() + ": time does not increase");
    }
    return {};
}

Status read_expected(Scene& scene) {
    TERES_TRY_ASSIGN(const Table table, Table::read(scene.folder / "expected_state.csv"));
    const auto& names = scene.filter.names;
    std::vector<std::size_t> columns;
    for (const auto& name : names) {
        TERES_TRY_ASSIGN(columns.emplace_back(), table.column({name}));
    }
    TERES_TRY_ASSIGN(const std::size_t step, table.column({"step"}));
    const auto rows = static_cast<std::size_t>(scene.compared_rows);
    if (table.num_rows() < rows)
        return invalid_input(table.name() + ": " + std::to_string(table.num_rows()) + " rows, but compared_rows is " +
                             std::to_string(rows));
    scene.expected_state.resize(scene.compared_rows, static_cast<Eigen::Index>(names.size()));
    for (std::size_t row = 0; row < rows; ++row) {
        TERES_TRY_ASSIGN(const auto at, table.index(row, step, 1000000000));
        if (at < 1 || (row > 0 && at <= scene.expected_step.back()))
            return invalid_input(table.place(row) + ": step " + std::to_string(at) + " does not follow the one before");
        scene.expected_step.push_back(at);
        for (std::size_t i = 0; i < columns.size(); ++i)
            scene.expected_state(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(i)) =
                table.number(row, columns[i]);
    }
    return {};
}

}  // namespace teres::peer
