// Writes a case folder (teres-case-1): for tools that make cases and for tests. Numbers keep every bit.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

/// Writes all of `data` but the folder name and the validation truth; empty tables are left out. The folder
/// is made; files of the format that are already there are overwritten, optional files that `data` lacks are
/// removed. read_case(folder) gives back the same data. Errors: kHostFault if a file cannot be written.
Status write_case(const Case& data, const std::filesystem::path& folder);

/// `t_s,<id_column>,x_m,y_m,z_m`: observations, predictions (--predict) and validation.csv.
Status write_positions(const std::filesystem::path& file, const std::string& id_column,
                       std::span<const PositionSample> samples);

/// Legacy ASCII VTK of the tetrahedra with cell scalar `region` if there is one, as read_vtk_tets reads it.
Status write_vtk_tets(const std::filesystem::path& file, const TetMeshData& mesh, const std::string& title);

}  // namespace teres
