#include "tools/atlas/annotated_livers.h"

#include <Eigen/LU>
#include <algorithm>
#include <set>

#include "core/case/csv_table.h"
#include "core/case/text_file.h"

namespace teres {

namespace fs = std::filesystem;
using Eigen::Vector3d;

namespace {

constexpr double kSmallestLiver_m = 0.10, kLargestLiver_m = 0.60;  // diagonal of the bounding box

void mark(AnnotatedLiver& liver, const std::string& ligament, std::int32_t vertex) {
    auto& nodes = liver.nodes[ligament];
    if (std::find(nodes.begin(), nodes.end(), vertex) == nodes.end()) nodes.push_back(vertex);
}

// Edges as points every quarter, so that a strip is as dense as its mesh is not.
Status read_marked_edges(const fs::path& file, AnnotatedLiver& liver) {
    static const std::vector<CsvColumn> kColumns{{"class", CsvKind::kText}, {"v0", CsvKind::kId}, {"v1", CsvKind::kId}};
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, kColumns));
    std::set<std::pair<std::int32_t, std::int32_t>> edges;
    for (const auto& f : liver.surface.F)
        for (std::size_t k = 0; k < 3; ++k) edges.insert(std::minmax(f[k], f[(k + 1) % 3]));
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        const std::string name = table.text(row, 0) == "ligament" ? "falciform" : table.text(row, 0);
        const std::int32_t a = table.id(row, 1), b = table.id(row, 2);
        if (!edges.contains(std::minmax(a, b)))
            return invalid_input(table.place(row) + ": annotation off the surface: " + std::to_string(a) + "-" +
                                 std::to_string(b) + " is not an edge of the surface of " +
                                 std::to_string(liver.surface.num_vertices()) + " vertices");
        for (const double s : {0.0, 0.25, 0.5, 0.75, 1.0})
            liver.marks[name].push_back((1.0 - s) * liver.surface.V.col(a) + s * liver.surface.V.col(b));
        mark(liver, name, a);
        mark(liver, name, b);
    }
    if (table.num_rows() == 0) return invalid_input(table.name() + ": no annotation");
    return {};
}

Status read_vertex_distances(const fs::path& file, AnnotatedLiver& liver) {
    static const std::map<std::string, std::string> kParts{
        {"coronary_ligament", "coronary"}, {"falciform_ligament", "falciform"},
        {"round_ligament", "round"},       {"triangular_ligament", "triangular"},
        {"bare_area", "bare_area"},        {"hepataduodenal_ligament", "hepatoduodenal"},
        {"ligamentum_venosum", "venosum"}};
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    const std::string header = text.substr(0, text.find_first_of("\r\n"));
    std::vector<CsvColumn> columns;
    for (std::size_t begin = 0; begin <= header.size();) {
        const std::size_t end = std::min(header.find(',', begin), header.size());
        columns.push_back({header.substr(begin, end - begin), columns.empty() ? CsvKind::kId : CsvKind::kNumber});
        begin = end + 1;
    }
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::parse(text, file.string(), columns));
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        const std::int32_t v = table.id(row, 0);
        if (v >= liver.surface.num_vertices())
            return invalid_input(table.place(row) + ": annotation off the surface: vertex " + std::to_string(v) +
                                 " does not exist, there are " + std::to_string(liver.surface.num_vertices()));
        for (std::size_t c = 1; c < columns.size(); ++c) {
            const auto part = kParts.find(columns[c].name);
            if (part == kParts.end() || 1e-3 * table.number(row, c) > kTouching_m) continue;
            liver.marks[part->second].push_back(liver.surface.V.col(v));
            liver.nodes[part->second].push_back(v);
        }
    }
    return {};
}

std::vector<fs::path> sorted_entries(const fs::path& folder) {
    std::vector<fs::path> entries;
    std::error_code failure;
    for (const auto& entry : fs::directory_iterator(folder, failure)) entries.push_back(entry.path());
    std::sort(entries.begin(), entries.end());
    return entries;
}

}  // namespace

Result<Eigen::Matrix3d> rotation_to_ras(const std::string& frame) {
    static const std::string kPositive = "RAS", kNegative = "LPI";
    Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
    for (std::size_t k = 0; k < frame.size() && k < 3; ++k) {
        const std::size_t plus = kPositive.find(frame[k]), minus = kNegative.find(frame[k]);
        if (plus != std::string::npos) R(static_cast<Eigen::Index>(plus), static_cast<Eigen::Index>(k)) = 1.0;
        if (minus != std::string::npos) R(static_cast<Eigen::Index>(minus), static_cast<Eigen::Index>(k)) = -1.0;
    }
    if (frame.size() != 3 || std::abs(R.determinant()) < 0.5)
        return invalid_input("frame " + in_quotes(frame) + ", expected one letter each of R/L, A/P, S/I, e.g. RAS");
    if (R.determinant() < 0.0) return invalid_input("frame " + in_quotes(frame) + " is mirrored (left-handed)");
    return R;
}

Status check_liver(TriangleSurface& surface, const std::string& name, double unit_m) {
    const Vector3d size = surface.V.rowwise().maxCoeff() - surface.V.rowwise().minCoeff();
    if (size.norm() < kSmallestLiver_m || size.norm() > kLargestLiver_m)
        return invalid_input(name + ": the surface measures " + to_text(size[0]) + " x " + to_text(size[1]) + " x " +
                             to_text(size[2]) + " m with the unit given, a liver has a diagonal of " +
                             to_text(kSmallestLiver_m) + " to " + to_text(kLargestLiver_m) + " m: wrong --unit?");
    return check_closed(surface, name, unit_m);
}

Result<std::vector<AnnotatedLiver>> read_annotated_livers(const fs::path& folder, double unit_m,
                                                          const std::string& frame) {
    TERES_TRY_ASSIGN(const Eigen::Matrix3d R, rotation_to_ras(frame));
    std::vector<std::pair<fs::path, fs::path>> found;  // surface, annotation
    for (const fs::path& file : sorted_entries(folder / "mesh"))
        found.emplace_back(file, folder / "landmarks" / (file.stem().string() + ".csv"));
    for (const fs::path& entry : sorted_entries(folder))
        if (fs::exists(entry / "vertex_distance_mm.csv"))
            found.emplace_back(entry / "whole_liver.obj", entry / "vertex_distance_mm.csv");
    if (found.empty())
        return invalid_input(folder.string() +
                             ": no annotated liver, expected mesh/NAME.obj with landmarks/NAME.csv or "
                             "NAME/whole_liver.obj with NAME/vertex_distance_mm.csv");
    std::vector<AnnotatedLiver> livers;
    for (const auto& [file, annotation] : found) {
        AnnotatedLiver liver;
        const bool edges = annotation.filename() != "vertex_distance_mm.csv";
        liver.name = (edges ? file.stem() : file.parent_path().filename()).string();
        TERES_TRY_ASSIGN(liver.surface, read_surface(file, unit_m));
        TERES_TRY(check_liver(liver.surface, file.string(), unit_m));
        liver.surface.V = R * liver.surface.V;
        TERES_TRY(edges ? read_marked_edges(annotation, liver) : read_vertex_distances(annotation, liver));
        livers.push_back(std::move(liver));
    }
    return livers;
}

}  // namespace teres
