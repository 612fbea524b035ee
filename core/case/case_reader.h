// Reads a case folder (teres-case-1). Every error names file and line (or JSON key), the value and the bound.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

struct CaseReadOptions {
    bool observations = true;             ///< read observations.csv
    double max_marker_distance_m = 0.02;  ///< a marker further from the surface than this is an error
};

/// Reads and checks the whole folder. Never opens validation.csv.
/// Errors (kInvalidInput): missing or malformed file, unknown key, non-finite value where one is needed,
/// inverted or degenerate tetrahedron, disconnected or overlapping mesh, node id out of range, weights that
/// do not sum to 1, marker off the surface, time going backwards, no markers, coordinates that look like
/// millimetres.
Result<Case> read_case(const std::filesystem::path& folder, const CaseReadOptions& options = {});

/// Legacy ASCII VTK unstructured grid of tetrahedra. `name` stands in the error texts.
/// Tetrahedra of negative orientation are an error unless `keep_order` (the peer's meshes: order matters).
Result<TetMeshData> parse_vtk_tets(std::string_view text, const std::string& name, bool keep_order = false);
Result<TetMeshData> read_vtk_tets(const std::filesystem::path& file, bool keep_order = false);

/// case.json from its text, into the header part of `out` (everything but the arrays).
Status parse_case_json(std::string_view text, const std::string& name, Case& out);

/// `t_s,<id_column>,x_m,y_m,z_m`: true or predicted positions (for `teres score` only). Unless `any_order`,
/// time must not go backwards and (t_s, id) must be unique.
Result<std::vector<PositionSample>> read_positions(const std::filesystem::path& file, const std::string& id_column,
                                                   bool any_order = false);

}  // namespace teres
