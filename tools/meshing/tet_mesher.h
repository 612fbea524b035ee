// A closed triangle surface to quality tetrahedra by the program gmsh (called, not linked): the surface is
// reparametrised and meshed anew at one size h, which is corrected (N ~ h^-3) until the number of tetrahedra
// fits and no sliver is left.
#pragma once

#include <functional>

#include "core/case/case.h"
#include "tools/atlas/triangle_surface.h"

namespace teres {

struct MeshingSettings {
    int num_tets = 7500;
    double tolerance = 0.08;         ///< of num_tets
    double feature_angle_deg = 180;  ///< edges sharper than this are kept; 180: none (an organ)
    double good_ratio = 0.1;         ///< worst tetrahedron; below it another size is tried
    int max_rounds = 8;
};

struct MeshQuality {
    double min_ratio = 0.0, p5_ratio = 0.0, mean_ratio = 0.0;  ///< 3 inradius / circumradius; 1 is regular
    double min_dihedral_deg = 0.0, max_dihedral_deg = 0.0;
    double volume_m3 = 0.0;
    double edge_m = 0.0;  ///< mean
};

struct TetMeshing {
    TetMeshData mesh;
    MeshQuality quality;
    double size_m = 0.0;              ///< h
    double surface_distance_m = 0.0;  ///< largest, from the given vertices to the boundary of the mesh
};

MeshQuality measure_quality(const TetMeshData& mesh);

/// `surface` is closed (check_closed). `done(round, tetrahedra)` after each round.
/// Errors: kInvalidInput, the surface cuts itself (place named); kHostFault, gmsh is missing; kNotUsable,
/// gmsh failed (its words) or the number of tetrahedra is not met within max_rounds.
Result<TetMeshing> mesh_surface(const TriangleSurface& surface, const std::string& name, double unit_m,
                                const MeshingSettings& settings, const std::function<void(int, std::size_t)>& done);

}  // namespace teres
