#include "core/case/case_writer.h"

#include <nlohmann/json.hpp>
#include <system_error>

#include "core/case/text_writer.h"

namespace teres {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

const char* law_name(BodyLaw law) {
    switch (law) {
        case BodyLaw::kStVK:
            return "stvk";
        case BodyLaw::kCorotational:
            return "corotational";
        case BodyLaw::kOgden:
            return "ogden";
        case BodyLaw::kNeoHookean:
            return "neo_hookean";
    }
    return "";
}

const char* law_name(SpringLaw law) {
    switch (law) {
        case SpringLaw::kLinear:
            return "linear";
        case SpringLaw::kRestShape:
            return "rest_shape";
        case SpringLaw::kCubic:
            return "cubic";
        case SpringLaw::kPolynomial:
            return "polynomial";
    }
    return "";
}

Json header_of(const Case& c) {
    Json json;
    json["format"] = "teres-case-1";
    json["name"] = c.name;
    if (!c.frame.empty()) json["frame"] = c.frame;
    json["time"] = {{"frames", c.num_frames}, {"dt_s", c.dt_s}, {"quasi_static", c.quasi_static}};
    Json& body = json["body"];
    body["law"] = law_name(c.body.law);
    if (c.body.law == BodyLaw::kOgden) {
        body["shear_modulus_pa"] = c.body.shear_modulus_pa;
        body["alpha"] = c.body.alpha;
        body["bulk_modulus_pa"] = c.body.bulk_modulus_pa;
    }
    body["youngs_modulus_pa"] = c.body.youngs_modulus_pa;
    body["poissons_ratio"] = c.body.poissons_ratio;
    body["density_kg_m3"] = c.body.density_kg_m3;
    body["rayleigh_mass_1_s"] = c.body.rayleigh_mass_1_s;
    body["rayleigh_stiffness_s"] = c.body.rayleigh_stiffness_s;
    if (c.ligament) {
        Json& ligament = json["ligament"];
        ligament["law"] = c.ligament->law == LigamentLaw::kNeoHookean ? "neo_hookean" : "cubic_spring";
        ligament["youngs_modulus_pa"] = c.ligament->youngs_modulus_pa;
        ligament["poissons_ratio"] = c.ligament->poissons_ratio;
        ligament["height_m"] = c.ligament->height_m;
        if (c.ligament->width_m > 0.0) ligament["width_m"] = c.ligament->width_m;
        if (c.ligament->thickness_m > 0.0) ligament["thickness_m"] = c.ligament->thickness_m;
    }
    json["gravity_m_s2"] = c.gravity_m_s2;
    Json& sensor = json["sensor"];
    sensor["noise_sigma_m"] = c.sensor.noise_sigma_m;
    if (c.sensor.camera_position_m) sensor["camera_position_m"] = *c.sensor.camera_position_m;
    if (c.sensor.view_direction) sensor["view_direction"] = *c.sensor.view_direction;
    if (c.sensor.up) sensor["up"] = *c.sensor.up;
    sensor["latency_s"] = c.sensor.latency_s;
    if (!c.stream.empty()) json["stream"] = c.stream;
    return json;
}

std::string rest_table(const char* id_column, std::span<const MarkerRest> points) {
    TextWriter out;
    out.line(id_column, "x_m", "y_m", "z_m");
    for (const MarkerRest& p : points) out.line(p.id, p.position_m);
    return out.text();
}

std::string load_node_table(std::span<const LoadRegion> regions) {
    TextWriter out;
    out.line("region", "node_id", "weight");
    for (const LoadRegion& region : regions)
        for (std::size_t i = 0; i < region.node_ids.size(); ++i)
            out.line(region.name, region.node_ids[i], region.weights[i]);
    return out.text();
}

std::string load_table(const Case& c) {
    TextWriter out;
    out.line("t_s", "region", "fx_n", "fy_n", "fz_n");
    for (const LoadSample& load : c.loads)
        out.line(load.t_s, c.load_regions[static_cast<std::size_t>(load.region)].name, load.force_n);
    return out.text();
}

std::string tool_node_table(std::span<const ToolTie> tools) {
    TextWriter out;
    out.line("tool", "node_id", "stiffness_n_per_m");
    for (const ToolTie& tie : tools) out.line(tie.name, tie.node_id, tie.stiffness_n_per_m);
    return out.text();
}

// Ties of one tool share its samples: the row of its first tie stands for all.
std::string tool_table(const Case& c) {
    TextWriter out;
    out.line("t_s", "tool", "x_m", "y_m", "z_m");
    for (const ToolSample& sample : c.tool_samples) {
        const auto tool = static_cast<std::size_t>(sample.tool);
        std::size_t first = 0;
        while (c.tools[first].name != c.tools[tool].name) ++first;
        if (first == tool) out.line(sample.t_s, c.tools[tool].name, sample.position_m);
    }
    return out.text();
}

std::string spring_table(std::span<const SpringData> springs) {
    TextWriter out;
    out.line("node_id", "ax_m", "ay_m", "az_m", "law", "k1", "k2", "k3", "rest_length_m", "group");
    for (const SpringData& s : springs) out.line(s.node_id, s.anchor_m, law_name(s.law), s.k, s.rest_length_m, s.group);
    return out.text();
}

std::string sample_table(const std::string& id_column, std::span<const PositionSample> samples) {
    TextWriter out;
    out.line("t_s", id_column, "x_m", "y_m", "z_m");
    for (const PositionSample& sample : samples) out.line(sample.t_s, sample.id, sample.position_m);
    return out.text();
}

Status write_optional(const fs::path& file, bool present, const std::string& text) {
    if (present) return write_text_file(file, text);
    std::error_code code;
    fs::remove(file, code);
    if (code) return host_fault(file.string() + ": cannot be removed: " + code.message());
    return {};
}

}  // namespace

Status write_case(const Case& c, const fs::path& folder) {
    std::error_code code;
    fs::create_directories(folder, code);
    if (code) return host_fault(folder.string() + ": cannot be made: " + code.message());
    TERES_TRY(write_text_file(folder / "case.json", header_of(c).dump(1) + "\n"));
    TERES_TRY(write_vtk_tets(folder / "mesh.vtk", c.mesh, c.name));

    TextWriter clamped, prior;
    clamped.line("node_id");
    for (const std::int32_t id : c.clamped) clamped.line(id);
    prior.line("node_id", "probability");
    for (const NodeProbability& node : c.ligament_prior) prior.line(node.node_id, node.probability);
    TERES_TRY(write_optional(folder / "clamped.csv", !c.clamped.empty(), clamped.text()));
    TERES_TRY(write_optional(folder / "ligament_prior.csv", !c.ligament_prior.empty(), prior.text()));
    TERES_TRY(write_optional(folder / "load_nodes.csv", !c.load_regions.empty(), load_node_table(c.load_regions)));
    TERES_TRY(write_optional(folder / "loads.csv", !c.loads.empty(), load_table(c)));
    TERES_TRY(write_optional(folder / "tool_nodes.csv", !c.tools.empty(), tool_node_table(c.tools)));
    TERES_TRY(write_optional(folder / "tool.csv", !c.tool_samples.empty(), tool_table(c)));
    TERES_TRY(write_optional(folder / "springs.csv", !c.springs.empty(), spring_table(c.springs)));
    TERES_TRY(write_text_file(folder / "markers_rest.csv", rest_table("marker_id", c.markers)));
    TERES_TRY(write_optional(folder / "observations.csv", !c.observations.empty(),
                             sample_table("marker_id", c.observations)));
    return write_optional(folder / "validation_rest.csv", !c.validation_rest.empty(),
                          rest_table("point_id", c.validation_rest));
}

Status write_positions(const fs::path& file, const std::string& id_column, std::span<const PositionSample> samples) {
    return write_text_file(file, sample_table(id_column, samples));
}

Status write_vtk_tets(const fs::path& file, const TetMeshData& mesh, const std::string& title) {
    TextWriter out(' ');
    out.line("# vtk DataFile Version 3.0");
    std::string one_line = title.substr(0, 255);  // bound of the format
    for (char& c : one_line)
        if (c == '\n' || c == '\r') c = ' ';
    out.line(one_line);
    out.line("ASCII");
    out.line("DATASET UNSTRUCTURED_GRID");
    out.line("POINTS", mesh.nodes.size(), "double");
    for (const Point& node : mesh.nodes) out.line(node);
    out.line("CELLS", mesh.tets.size(), 5 * mesh.tets.size());
    for (const auto& tet : mesh.tets) out.line(4, tet);
    out.line("CELL_TYPES", mesh.tets.size());
    for (std::size_t i = 0; i < mesh.tets.size(); ++i) out.line(10);
    if (!mesh.region.empty()) {
        out.line("CELL_DATA", mesh.tets.size());
        out.line("SCALARS", "region", "int", 1);
        out.line("LOOKUP_TABLE", "default");
        for (const std::int32_t region : mesh.region) out.line(region);
    }
    return write_text_file(file, out.text());
}

}  // namespace teres
