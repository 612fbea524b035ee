// Cuts with the pattern of the tangent kept: a tetrahedron that is taken away has volume 0 from then on, nodal averages
// go over what is left, and a node without tissue is tied to its rest position so that every matrix stays regular.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "plugins/simulation/system.h"
#include "plugins/simulation/tet_mesh.h"

namespace teres {

/// The tetrahedra that are left without `cut`, one flag each. `holds` (per node) not empty: pieces without such a node
/// are not left either.
std::vector<char> tissue_left(const TetMesh& mesh, std::span<const std::int32_t> cut, const std::vector<char>& holds);

/// [loop] Takes the other tetrahedra out of mesh and system (linear tetrahedra; nothing else may look at them
/// meanwhile): strain points, masses, ligaments and loads. Returns how many they are.
std::int32_t keep_tissue(const std::vector<char>& left, TetMesh& mesh, MechanicalSystem::Parts& parts) noexcept;

/// [loop] Tethers of the parameter act on nothing any more.
void release(std::int32_t parameter, std::vector<Tether>& tethers) noexcept;

}  // namespace teres
