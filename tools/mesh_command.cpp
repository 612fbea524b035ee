// teres mesh SURFACE -o mesh.vtk: tetrahedra of a closed surface.
#include <cstdio>
#include <memory>

#include "core/case/case_writer.h"
#include "tools/commands.h"
#include "tools/meshing/tet_mesher.h"

namespace teres::tools {
namespace {

constexpr double kWorstRatio = 0.05, kLargestBody_m = 5.0, kSmallestBody_m = 1e-3;

struct MeshOptions {
    std::string surface_file, output, unit;
    MeshingSettings meshing;
    std::size_t repair = 0;
};

Result<int> mesh(const MeshOptions& o) {
    TERES_TRY_ASSIGN(TriangleSurface surface, read_surface(o.surface_file, 1.0));
    double size = (surface.V.rowwise().maxCoeff() - surface.V.rowwise().minCoeff()).norm();
    const std::string unit = !o.unit.empty() ? o.unit : size > kLargestBody_m ? "mm" : "m";
    TERES_TRY_ASSIGN(const double unit_m, unit_in_m(unit));
    if (o.unit.empty())
        std::printf("%s is %.4g across and no --unit is given: taken as %s\n", o.surface_file.c_str(), size,
                    unit.c_str());
    surface.V *= unit_m;
    size *= unit_m;
    if (size > kLargestBody_m || size < kSmallestBody_m)
        return invalid_input(o.surface_file + ": the surface is " + std::to_string(size) +
                             " m across with the unit given, expected 0.001 to 5 m: wrong --unit?");
    if (o.repair > 0)
        if (const std::size_t filled = fill_small_holes(surface, o.repair); filled > 0)
            std::printf("%zu hole(s) of at most %zu edges closed\n", filled, o.repair);
    if (const Status closed = check_closed(surface, o.surface_file, unit_m); !closed) {
        const bool open = find_defects(surface).num_border_edges > 0;
        return invalid_input(closed.error().text + (open ? "; --repair EDGES closes small holes" : ""));
    }
    TERES_TRY_ASSIGN(const TetMeshing made,
                     mesh_surface(surface, o.surface_file, unit_m, o.meshing, [](int round, std::size_t tets) {
                         std::fprintf(stderr, "round %d: %zu tetrahedra\n", round, tets);
                     }));
    TERES_TRY(write_vtk_tets(o.output, made.mesh, "tetrahedra of " + o.surface_file + ", metres"));
    const MeshQuality& q = made.quality;
    std::printf("%s: %zu tetrahedra, %zu nodes, mean edge %.2f mm\n", o.output.c_str(), made.mesh.tets.size(),
                made.mesh.nodes.size(), 1e3 * q.edge_m);
    std::printf("  3 inradius/circumradius: least %.3f, 5 %% below %.3f, mean %.3f\n", q.min_ratio, q.p5_ratio,
                q.mean_ratio);
    std::printf("  dihedral angles %.1f to %.1f degrees\n", q.min_dihedral_deg, q.max_dihedral_deg);
    std::printf("  volume %.1f mL (surface %.1f mL), surface kept within %.2f mm\n", 1e6 * q.volume_m3,
                1e6 * signed_volume(surface), 1e3 * made.surface_distance_m);
    if (q.min_ratio < kWorstRatio)
        return not_usable(o.output + ": worst tetrahedron has quality " + std::to_string(q.min_ratio) +
                          ", at least 0.05 is needed");
    return kDone;
}

}  // namespace

void add_mesh_command(CLI::App& app, int& exit_code) {
    auto o = std::make_shared<MeshOptions>();
    CLI::App* verb = add_verb(app, exit_code, "mesh", "tetrahedra of a closed surface, with their quality",
                              "  teres mesh liver.stl --unit mm -o mesh.vtk --tets 7500\n"
                              "  teres mesh liver.obj --unit mm -o mesh.vtk --repair 12\n"
                              "  teres mesh box.stl --unit m -o mesh.vtk --keep-edges 40\n"
                              "The mesh is in metres, as a case folder needs it. Calls the program gmsh.",
                              [o] {
                                  const Result<int> code = mesh(*o);
                                  return code ? *code : report(code.error());
                              });
    verb->add_option("surface", o->surface_file, "Closed triangle surface: .obj .stl .ply .vtk")
        ->required()
        ->type_name("SURFACE");
    verb->add_option("-o,--output", o->output, "Legacy VTK, metres")->required()->type_name("VTK");
    verb->add_option("--unit", o->unit,
                     "Unit of the surface: m, cm or mm; not given: mm if it is more than 5 across, else m");
    verb->add_option("--tets", o->meshing.num_tets, "Number of tetrahedra, met within 8 %")
        ->check(CLI::Range(50, 2000000))
        ->capture_default_str();
    verb->add_option("--keep-edges", o->meshing.feature_angle_deg, "Keep edges sharper than this angle; 180: none")
        ->check(CLI::Range(10.0, 180.0))
        ->capture_default_str();
    verb->add_option("--repair", o->repair, "Close holes of at most this many edges; 0: none")
        ->check(CLI::Range(0, 1000))
        ->capture_default_str();
}

}  // namespace teres::tools
