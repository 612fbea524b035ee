// An atlas folder: atlas.json, shape.obj (mm), ligaments.csv (density and its standard deviation per vertex
// of the subdivided shape, per m^2).
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/case/csv_table.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tools/atlas/ligament_atlas.h"

namespace teres {

namespace fs = std::filesystem;
constexpr const char* kFormat = "teres-atlas-1";

Status save_atlas(const LigamentAtlas& atlas, const fs::path& folder) {
    std::error_code failure;
    fs::create_directories(folder, failure);
    if (failure) return host_fault(folder.string() + ": " + failure.message());
    nlohmann::ordered_json json;
    json["format"] = kFormat;
    json["frame"] = "RAS";
    json["source"] = atlas.source;
    json["ligaments"] = nlohmann::ordered_json::array();
    std::string table = "vertex";
    for (const AtlasLigament& l : atlas.ligaments) {
        json["ligaments"].push_back({{"name", l.name}, {"livers", l.num_livers}, {"bandwidth_m", l.bandwidth_m}});
        table += "," + l.name + "_per_m2," + l.name + "_stdev_per_m2";
    }
    table += "\n";
    char text[48];
    for (Eigen::Index v = 0; v < atlas.fine.num_vertices(); ++v) {
        table += std::to_string(v);
        for (const AtlasLigament& l : atlas.ligaments) {
            std::snprintf(text, sizeof text, ",%.4g,%.3g", l.density[v], l.density_stdev[v]);
            table += text;
        }
        table += "\n";
    }
    TERES_TRY(write_text_file(folder / "atlas.json", json.dump(1) + "\n"));
    TERES_TRY(write_text_file(folder / "ligaments.csv", table));
    return write_obj(atlas.shape, folder / "shape.obj",
                     "common shape of the atlas, mm; x right, y anterior, z superior", 1e-3);
}

Result<LigamentAtlas> load_atlas(const fs::path& folder) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(folder / "atlas.json"));
    const auto json = nlohmann::json::parse(text, nullptr, false);
    const auto wrong = [&](const std::string& what) {
        return invalid_input((folder / "atlas.json").string() + ": " + what);
    };
    if (!json.is_object() || json.value("format", nlohmann::json()) != kFormat)
        return wrong(std::string("not an atlas, expected \"format\": \"") + kFormat + "\"");
    LigamentAtlas atlas;
    std::vector<CsvColumn> columns{{"vertex", CsvKind::kId}};
    const auto list = json.find("ligaments");
    if (list == json.end() || !list->is_array() || list->empty()) return wrong("no ligaments");
    for (const auto& entry : *list) {
        const auto name = entry.is_object() ? entry.find("name") : entry.end();
        if (!entry.is_object() || name == entry.end() || !name->is_string() || !entry.contains("livers") ||
            !entry["livers"].is_number_integer() || !entry.contains("bandwidth_m") || !entry["bandwidth_m"].is_number())
            return wrong("a ligament needs name, livers and bandwidth_m");
        AtlasLigament l;
        l.name = name->get<std::string>();
        l.num_livers = entry["livers"].get<int>();
        l.bandwidth_m = entry["bandwidth_m"].get<double>();
        columns.push_back({l.name + "_per_m2", CsvKind::kNumber});
        columns.push_back({l.name + "_stdev_per_m2", CsvKind::kNumber});
        atlas.ligaments.push_back(l);
    }
    if (const auto source = json.find("source"); source != json.end() && source->is_string()) atlas.source = *source;
    TERES_TRY_ASSIGN(atlas.shape, read_surface(folder / "shape.obj", 1e-3));
    TERES_TRY(check_closed(atlas.shape, (folder / "shape.obj").string(), 1e-3));
    atlas.fine = subdivided(atlas.shape);
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(folder / "ligaments.csv", columns));
    if (static_cast<Eigen::Index>(table.num_rows()) != atlas.fine.num_vertices())
        return invalid_input(table.name() + ": " + std::to_string(table.num_rows()) +
                             " rows, the subdivided shape has " + std::to_string(atlas.fine.num_vertices()) +
                             " vertices");
    for (std::size_t k = 0; k < atlas.ligaments.size(); ++k) {
        AtlasLigament& l = atlas.ligaments[k];
        l.density.resize(atlas.fine.num_vertices());
        l.density_stdev.resize(atlas.fine.num_vertices());
        for (std::size_t row = 0; row < table.num_rows(); ++row) {
            l.density[static_cast<Eigen::Index>(row)] = table.number(row, 1 + 2 * k);
            l.density_stdev[static_cast<Eigen::Index>(row)] = table.number(row, 2 + 2 * k);
            if (table.number(row, 1 + 2 * k) < 0.0) return invalid_input(table.place(row) + ": negative density");
        }
        if (!(l.density.sum() > 0.0)) return invalid_input(table.name() + ": " + l.name + " is nowhere");
    }
    return atlas;
}

}  // namespace teres
