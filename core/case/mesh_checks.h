// What a body's mesh must be beyond well-formed: one piece, every node used, no overlap, in metres; how large it is.
#pragma once

#include <string>

#include "core/case/case.h"
#include "core/result.h"

namespace teres {

/// For a mesh whose tetrahedra are positive (parse_vtk_tets). Errors (kInvalidInput) name `name` (the file),
/// the node or piece, and the bound.
Status check_body_mesh(const TetMeshData& mesh, const std::string& name);

/// Diagonal of the bounding box.
double size_m(const TetMeshData& mesh);

}  // namespace teres
