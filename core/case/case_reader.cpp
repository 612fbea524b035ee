#include "core/case/case_reader.h"

#include <cmath>
#include <map>
#include <set>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "core/case/csv_table.h"
#include "core/case/mesh_checks.h"
#include "core/case/surface.h"
#include "core/case/text_file.h"

namespace teres {
namespace {

namespace fs = std::filesystem;
using Columns = std::vector<CsvColumn>;

constexpr CsvKind kNumber = CsvKind::kNumber, kNumberOrNan = CsvKind::kNumberOrNan, kId = CsvKind::kId,
                  kText = CsvKind::kText;
constexpr double kWeightSumTolerance = 1e-3;
constexpr double kCoordinateBound_m = 1e3;

tl::unexpected<Error> wrong(const CsvTable& table, std::size_t row, const std::string& text) {
    return invalid_input(table.place(row) + ": " + text);
}

// An optional file: nullopt when absent.
Result<std::optional<CsvTable>> read_optional(const fs::path& file, const Columns& columns) {
    std::error_code code;
    if (!fs::exists(file, code)) return std::nullopt;
    TERES_TRY_ASSIGN(CsvTable table, CsvTable::read(file, columns));
    return table;
}

Result<std::int32_t> node_id(const CsvTable& table, std::size_t row, std::size_t column, const TetMeshData& mesh) {
    const std::int32_t id = table.id(row, column);
    if (static_cast<std::size_t>(id) >= mesh.nodes.size())
        return wrong(table, row,
                     "node_id " + std::to_string(id) + " is outside the mesh, which has " +
                         std::to_string(mesh.nodes.size()) + " nodes (0-based)");
    return id;
}

Point point(const CsvTable& table, std::size_t row, std::size_t first_column) {
    return {table.number(row, first_column), table.number(row, first_column + 1), table.number(row, first_column + 2)};
}

// Three numbers or three NaN; a partly lost position is a broken file.
Result<Point> position(const CsvTable& table, std::size_t row, std::size_t first_column) {
    const Point p = point(table, row, first_column);
    int lost = 0;
    for (const double x : p) {
        lost += std::isnan(x) ? 1 : 0;
        if (std::abs(x) > kCoordinateBound_m)
            return wrong(table, row,
                         "coordinate " + to_text(x) + " m is outside +-" + to_text(kCoordinateBound_m) + " m");
    }
    if (lost != 0 && lost != 3)
        return wrong(table, row, std::to_string(lost) + " of 3 coordinates are NaN; a lost point has NaN in all three");
    return p;
}

// Time may stand still (several ids of one frame) but not go back; (time, id) is unique.
class TimeCheck {
  public:
    Status next(const CsvTable& table, std::size_t row, std::int64_t id, const std::string& what) {
        const double t = table.number(row, 0);
        if (row > 0 && t < time_)
            return wrong(table, row, "t_s = " + to_text(t) + " goes backwards: the row before has " + to_text(time_));
        if (row == 0 || t > time_) seen_.clear();
        time_ = t;
        if (!seen_.insert(id).second) return wrong(table, row, what + " appears twice at t_s = " + to_text(t));
        return {};
    }

  private:
    double time_ = 0.0;
    std::unordered_set<std::int64_t> seen_;
};

Status read_clamped(Case& c) {
    TERES_TRY_ASSIGN(const auto table, read_optional(c.folder / "clamped.csv", {{"node_id", kId}}));
    if (!table) return {};
    std::unordered_set<std::int32_t> seen;
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        TERES_TRY_ASSIGN(const std::int32_t id, node_id(*table, row, 0, c.mesh));
        if (!seen.insert(id).second) return wrong(*table, row, "node_id " + std::to_string(id) + " appears twice");
        c.clamped.push_back(id);
    }
    return {};
}

Status read_ligament_prior(Case& c) {
    const Columns columns{{"node_id", kId}, {"probability", kNumber}};
    TERES_TRY_ASSIGN(const auto table, read_optional(c.folder / "ligament_prior.csv", columns));
    if (!table) return {};
    std::unordered_set<std::int32_t> seen;
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        TERES_TRY_ASSIGN(const std::int32_t id, node_id(*table, row, 0, c.mesh));
        const double probability = table->number(row, 1);
        if (!(probability >= 0.0 && probability <= 1.0))
            return wrong(*table, row, "probability " + to_text(probability) + " is outside [0, 1]");
        if (!seen.insert(id).second) return wrong(*table, row, "node_id " + std::to_string(id) + " appears twice");
        c.ligament_prior.push_back({id, probability});
    }
    return {};
}

Status read_loads(Case& c) {
    const Columns node_columns{{"region", kText}, {"node_id", kId}, {"weight", kNumber}};
    TERES_TRY_ASSIGN(const auto nodes, read_optional(c.folder / "load_nodes.csv", node_columns));
    std::map<std::string, std::int32_t> region_index;
    std::vector<std::size_t> first_row;
    if (nodes) {
        std::set<std::pair<std::int32_t, std::int32_t>> seen;
        for (std::size_t row = 0; row < nodes->num_rows(); ++row) {
            const std::string& name = nodes->text(row, 0);
            const auto [found, is_new] = region_index.emplace(name, static_cast<std::int32_t>(c.load_regions.size()));
            if (is_new) {
                c.load_regions.push_back({name, {}, {}});
                first_row.push_back(row);
            }
            TERES_TRY_ASSIGN(const std::int32_t id, node_id(*nodes, row, 1, c.mesh));
            if (!seen.insert({found->second, id}).second)
                return wrong(*nodes, row,
                             "node_id " + std::to_string(id) + " appears twice in region " + in_quotes(name));
            const double weight = nodes->number(row, 2);
            if (weight < 0.0) return wrong(*nodes, row, "weight " + to_text(weight) + " is below 0");
            LoadRegion& region = c.load_regions[static_cast<std::size_t>(found->second)];
            region.node_ids.push_back(id);
            region.weights.push_back(weight);
        }
        for (std::size_t r = 0; r < c.load_regions.size(); ++r) {
            double sum = 0.0;
            for (const double weight : c.load_regions[r].weights) sum += weight;
            if (!(std::abs(sum - 1.0) <= kWeightSumTolerance))
                return wrong(*nodes, first_row[r],
                             "weights of region " + in_quotes(c.load_regions[r].name) + " sum to " + to_text(sum) +
                                 ", expected 1 +- " + to_text(kWeightSumTolerance));
        }
    }
    const Columns columns{{"t_s", kNumber}, {"region", kText}, {"fx_n", kNumber}, {"fy_n", kNumber}, {"fz_n", kNumber}};
    TERES_TRY_ASSIGN(const auto table, read_optional(c.folder / "loads.csv", columns));
    if (!table) return {};
    TimeCheck time;
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        const auto region = region_index.find(table->text(row, 1));
        if (region == region_index.end())
            return wrong(*table, row, "region " + in_quotes(table->text(row, 1)) + " is not in load_nodes.csv");
        TERES_TRY(time.next(*table, row, region->second, "region " + in_quotes(region->first)));
        c.loads.push_back({table->number(row, 0), region->second, point(*table, row, 2)});
    }
    return {};
}

Status read_tools(Case& c) {
    const Columns node_columns{{"tool", kText}, {"node_id", kId}, {"stiffness_n_per_m", kNumber}};
    TERES_TRY_ASSIGN(const auto nodes, read_optional(c.folder / "tool_nodes.csv", node_columns));
    std::map<std::string, std::vector<std::int32_t>> ties;  // a tool may hold several nodes
    if (nodes) {
        std::set<std::pair<std::string, std::int32_t>> seen;
        for (std::size_t row = 0; row < nodes->num_rows(); ++row) {
            TERES_TRY_ASSIGN(const std::int32_t id, node_id(*nodes, row, 1, c.mesh));
            const std::string& name = nodes->text(row, 0);
            const double stiffness = nodes->number(row, 2);
            if (stiffness < 0.0) return wrong(*nodes, row, "stiffness_n_per_m " + to_text(stiffness) + " is below 0");
            if (!seen.insert({name, id}).second)
                return wrong(*nodes, row,
                             "node_id " + std::to_string(id) + " appears twice for tool " + in_quotes(name));
            ties[name].push_back(static_cast<std::int32_t>(c.tools.size()));
            c.tools.push_back({name, id, stiffness});
        }
    }
    const Columns columns{
        {"t_s", kNumber}, {"tool", kText}, {"x_m", kNumberOrNan}, {"y_m", kNumberOrNan}, {"z_m", kNumberOrNan}};
    TERES_TRY_ASSIGN(const auto table, read_optional(c.folder / "tool.csv", columns));
    if (!table) return {};
    TimeCheck time;
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        const auto tool = ties.find(table->text(row, 1));
        if (tool == ties.end())
            return wrong(*table, row, "tool " + in_quotes(table->text(row, 1)) + " is not in tool_nodes.csv");
        TERES_TRY(time.next(*table, row, tool->second.front(), "tool " + in_quotes(tool->first)));
        TERES_TRY_ASSIGN(const Point p, position(*table, row, 2));
        for (const std::int32_t tie : tool->second) c.tool_samples.push_back({table->number(row, 0), tie, p});
    }
    return {};
}

Status read_springs(Case& c) {
    const Columns columns{
        {"node_id", kId}, {"ax_m", kNumber}, {"ay_m", kNumber}, {"az_m", kNumber},          {"law", kText},
        {"k1", kNumber},  {"k2", kNumber},   {"k3", kNumber},   {"rest_length_m", kNumber}, {"group", kText}};
    TERES_TRY_ASSIGN(const auto table, read_optional(c.folder / "springs.csv", columns));
    if (!table) return {};
    const std::map<std::string, SpringLaw> laws{{"linear", SpringLaw::kLinear},
                                                {"rest_shape", SpringLaw::kRestShape},
                                                {"cubic", SpringLaw::kCubic},
                                                {"polynomial", SpringLaw::kPolynomial}};
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        SpringData spring;
        TERES_TRY_ASSIGN(spring.node_id, node_id(*table, row, 0, c.mesh));
        TERES_TRY_ASSIGN(spring.anchor_m, position(*table, row, 1));
        const auto law = laws.find(table->text(row, 4));
        if (law == laws.end())
            return wrong(*table, row,
                         "law " + in_quotes(table->text(row, 4)) + ", expected linear|rest_shape|cubic|polynomial");
        spring.law = law->second;
        for (std::size_t i = 0; i < 3; ++i) spring.k[i] = table->number(row, 5 + i);
        if (spring.k[0] < 0.0) return wrong(*table, row, "k1 = " + to_text(spring.k[0]) + " is below 0");
        spring.rest_length_m = table->number(row, 8);
        if (spring.rest_length_m < 0.0)
            return wrong(*table, row, "rest_length_m = " + to_text(spring.rest_length_m) + " is below 0");
        // the strain of this law is relative to the rest length
        if (spring.law == SpringLaw::kPolynomial && spring.rest_length_m == 0.0)
            return wrong(*table, row, "rest_length_m = 0, must be above 0 for law polynomial");
        spring.group = table->text(row, 9);
        c.springs.push_back(std::move(spring));
    }
    return {};
}

Result<std::vector<MarkerRest>> read_rest_points(const CsvTable& table) {
    std::vector<MarkerRest> points;
    std::unordered_set<std::int32_t> seen;
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        const std::int32_t id = table.id(row, 0);
        if (!seen.insert(id).second) return wrong(table, row, "id " + std::to_string(id) + " appears twice");
        TERES_TRY_ASSIGN(const Point p, position(table, row, 1));
        points.push_back({id, p});
    }
    return points;
}

Columns rest_columns(const char* id_column) {
    return {{id_column, kId}, {"x_m", kNumber}, {"y_m", kNumber}, {"z_m", kNumber}};
}

Status read_markers(Case& c, double max_distance_m) {
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(c.folder / "markers_rest.csv", rest_columns("marker_id")));
    if (table.num_rows() == 0) return invalid_input(table.name() + ":1: no markers, at least 1 is needed");
    TERES_TRY_ASSIGN(c.markers, read_rest_points(table));
    const Surface surface(c.mesh);
    for (std::size_t row = 0; row < c.markers.size(); ++row) {
        const double distance_m = surface.closest(c.markers[row].position_m).distance_m;
        if (!(distance_m <= max_distance_m))
            return wrong(table, row,
                         "marker " + std::to_string(c.markers[row].id) + " is " + to_text(distance_m) +
                             " m off the surface, at most " + to_text(max_distance_m) + " m is allowed");
    }
    return {};
}

Result<std::vector<PositionSample>> read_samples(const CsvTable& table, bool any_order) {
    std::vector<PositionSample> samples;
    samples.reserve(table.num_rows());
    TimeCheck time;
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        const std::int32_t id = table.id(row, 1);
        if (!any_order) TERES_TRY(time.next(table, row, id, "id " + std::to_string(id)));
        TERES_TRY_ASSIGN(const Point p, position(table, row, 2));
        samples.push_back({table.number(row, 0), id, p});
    }
    return samples;
}

Columns sample_columns(const std::string& id_column) {
    return {{"t_s", kNumber}, {id_column, kId}, {"x_m", kNumberOrNan}, {"y_m", kNumberOrNan}, {"z_m", kNumberOrNan}};
}

Status read_observations(Case& c) {
    const fs::path file = c.folder / "observations.csv";
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, sample_columns("marker_id")));
    if (table.num_rows() == 0) return invalid_input(table.name() + ":1: no observations");
    TERES_TRY_ASSIGN(c.observations, read_samples(table, false));
    std::unordered_set<std::int32_t> known;
    for (const MarkerRest& marker : c.markers) known.insert(marker.id);
    bool any_seen = false;
    for (std::size_t row = 0; row < c.observations.size(); ++row) {
        const PositionSample& sample = c.observations[row];
        if (known.count(sample.id) == 0)
            return wrong(table, row, "marker_id " + std::to_string(sample.id) + " is not in markers_rest.csv");
        any_seen = any_seen || !std::isnan(sample.position_m[0]);
    }
    if (!any_seen) return invalid_input(table.name() + ": all " + std::to_string(table.num_rows()) + " rows are NaN");
    return {};
}

}  // namespace

Result<Case> read_case(const fs::path& folder, const CaseReadOptions& options) {
    std::error_code code;
    if (!fs::is_directory(folder, code))
        return invalid_input(folder.string() + ": not a folder (of format teres-case-1)");
    Case c;
    c.folder = folder;
    const fs::path header = folder / "case.json";
    TERES_TRY_ASSIGN(const std::string header_text, read_text_file(header));
    TERES_TRY(parse_case_json(header_text, header.string(), c));

    const fs::path mesh_file = folder / "mesh.vtk";
    TERES_TRY_ASSIGN(c.mesh, read_vtk_tets(mesh_file));
    TERES_TRY(check_body_mesh(c.mesh, mesh_file.string()));
    TERES_TRY(read_clamped(c));
    TERES_TRY(read_ligament_prior(c));
    TERES_TRY(read_loads(c));
    TERES_TRY(read_tools(c));
    TERES_TRY(read_springs(c));
    TERES_TRY(read_markers(c, options.max_marker_distance_m));
    const auto rest_file = folder / "validation_rest.csv";
    TERES_TRY_ASSIGN(const auto rest, read_optional(rest_file, rest_columns("point_id")));
    if (rest) {
        TERES_TRY_ASSIGN(c.validation_rest, read_rest_points(*rest));
    }

    if (!c.stream.empty()) {
        if (!fs::exists(folder / c.stream, code))
            return invalid_input(header.string() + ": stream: " + (folder / c.stream).string() + " not found");
    } else if (options.observations) {
        TERES_TRY(read_observations(c));
    }
    return c;
}

Result<std::vector<PositionSample>> read_positions(const fs::path& file, const std::string& id_column, bool any_order) {
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, sample_columns(id_column)));
    return read_samples(table, any_order);
}

}  // namespace teres
