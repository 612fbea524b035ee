#include "core/case/vtk_writer.h"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <system_error>

#include "core/case/text_writer.h"

namespace teres {
namespace {

constexpr int kVtkLine = 3, kVtkTetra = 10;

std::string frame_text(const TetMeshData& mesh, const VtkFrame& frame, const std::string& title) {
    const std::size_t num_nodes = mesh.nodes.size(), num_tets = mesh.tets.size(), num_springs = frame.springs.size();
    TextWriter out(' ');
    out.line("# vtk DataFile Version 3.0");
    out.line(title);
    out.line("ASCII");
    out.line("DATASET UNSTRUCTURED_GRID");
    out.line("POINTS", num_nodes + num_springs, "double");
    const auto x = [&](std::size_t node, std::size_t axis) { return frame.positions_m[3 * node + axis]; };
    for (std::size_t node = 0; node < num_nodes; ++node) out.line(x(node, 0), x(node, 1), x(node, 2));
    for (const VtkSpring& spring : frame.springs) out.line(spring.anchor_m);
    out.line("CELLS", num_tets + num_springs, 5 * num_tets + 3 * num_springs);
    for (const auto& tet : mesh.tets) out.line(4, tet);
    for (std::size_t s = 0; s < num_springs; ++s) out.line(2, frame.springs[s].node_id, num_nodes + s);
    out.line("CELL_TYPES", num_tets + num_springs);
    for (std::size_t i = 0; i < num_tets; ++i) out.line(kVtkTetra);
    for (std::size_t i = 0; i < num_springs; ++i) out.line(kVtkLine);

    out.line("POINT_DATA", num_nodes + num_springs);
    out.line("VECTORS", "displacement_m", "double");
    for (std::size_t node = 0; node < num_nodes; ++node) {
        const Point& rest = mesh.nodes[node];
        out.line(x(node, 0) - rest[0], x(node, 1) - rest[1], x(node, 2) - rest[2]);
    }
    for (std::size_t i = 0; i < num_springs; ++i) out.line(0, 0, 0);
    if (!frame.attachment_probability.empty()) {
        out.line("SCALARS", "attachment_probability", "double", 1);
        out.line("LOOKUP_TABLE", "default");
        for (const double probability : frame.attachment_probability) out.line(probability);
        for (std::size_t i = 0; i < num_springs; ++i) out.line(0);
    }
    out.line("CELL_DATA", num_tets + num_springs);
    const auto cell_scalar = [&](const char* name, const char* type, double of_body, auto&& of_spring) {
        out.line("SCALARS", name, type, 1);
        out.line("LOOKUP_TABLE", "default");
        for (std::size_t i = 0; i < num_tets; ++i) out.line(of_body);
        for (const VtkSpring& spring : frame.springs) out.line(of_spring(spring));
    };
    cell_scalar("part", "int", 0.0, [](const VtkSpring&) { return 1.0; });
    cell_scalar("stiffness_n_per_m", "double", 0.0, [](const VtkSpring& s) { return s.stiffness_n_per_m; });
    cell_scalar("tension_n", "double", 0.0, [](const VtkSpring& s) { return s.tension_n; });
    return out.text();
}

}  // namespace

Result<VtkSeries> VtkSeries::make(const std::filesystem::path& folder, std::string name, const TetMeshData& mesh) {
    std::error_code code;
    std::filesystem::create_directories(folder, code);
    if (code) return host_fault(folder.string() + ": cannot be made: " + code.message());
    return VtkSeries(folder, std::move(name), mesh);
}

Status VtkSeries::add(const VtkFrame& frame) {
    const std::size_t num_nodes = mesh_->nodes.size();
    if (frame.positions_m.size() != 3 * num_nodes)
        return invalid_input("VTK frame of " + name_ + ": " + std::to_string(frame.positions_m.size()) +
                             " coordinates, expected " + std::to_string(3 * num_nodes));
    if (!frame.attachment_probability.empty() && frame.attachment_probability.size() != num_nodes)
        return invalid_input("VTK frame of " + name_ + ": " + std::to_string(frame.attachment_probability.size()) +
                             " probabilities, expected " + std::to_string(num_nodes));
    for (const VtkSpring& spring : frame.springs)
        if (spring.node_id < 0 || static_cast<std::size_t>(spring.node_id) >= num_nodes)
            return invalid_input("VTK frame of " + name_ + ": spring on node " + std::to_string(spring.node_id) +
                                 ", the mesh has " + std::to_string(num_nodes));
    char number[16];
    std::snprintf(number, sizeof number, "_%04zu.vtk", files_.size());
    const std::string file = name_ + number;
    char title[64];
    std::snprintf(title, sizeof title, "t = %.6g s", frame.t_s);
    TERES_TRY(write_text_file(folder_ / file, frame_text(*mesh_, frame, title)));
    files_.emplace_back(file, frame.t_s);
    return {};
}

Result<std::filesystem::path> VtkSeries::finish() const {
    nlohmann::ordered_json series;
    series["file-series-version"] = "1.0";
    series["files"] = nlohmann::ordered_json::array();
    for (const auto& [file, t_s] : files_) series["files"].push_back({{"name", file}, {"time", t_s}});
    const std::filesystem::path path = folder_ / (name_ + ".vtk.series");
    TERES_TRY(write_text_file(path, series.dump(1) + "\n"));
    return path;
}

}  // namespace teres
