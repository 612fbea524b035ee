#include "tools/meshing/tet_mesher.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>

#include "core/case/case_reader.h"
#include "core/case/mesh_checks.h"
#include "core/case/surface.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"

extern char** environ;

namespace teres {

namespace fs = std::filesystem;
using Eigen::Vector3d;

namespace {

struct ScratchFolder {
    fs::path path;
    ~ScratchFolder() {
        std::error_code ignored;
        if (!path.empty()) fs::remove_all(path, ignored);
    }
};

Vector3d vector(const Point& p) {
    return {p[0], p[1], p[2]};
}

std::string stl_text(const TriangleSurface& s) {
    std::string text = "solid surface\n";
    char line[96];
    for (std::size_t f = 0; f < s.F.size(); ++f) {
        text += "facet normal 0 0 0\nouter loop\n";
        for (int k = 0; k < 3; ++k) {
            const Vector3d c = s.corner(f, k);
            std::snprintf(line, sizeof line, "vertex %.9g %.9g %.9g\n", c[0], c[1], c[2]);
            text += line;
        }
        text += "endloop\nendfacet\n";
    }
    return text + "endsolid surface\n";
}

std::string geometry_text(double size_m, double feature_angle_deg) {
    char text[900];
    std::snprintf(text, sizeof text,
                  "Geometry.Tolerance = 1e-10;\n"
                  "Merge \"surface.stl\";\n"
                  "ClassifySurfaces{%.9g * Pi / 180, 1, 1, Pi};\n"
                  "CreateGeometry;\n"
                  "s() = Surface{:};\nSurface Loop(1) = s();\nVolume(1) = {1};\nPhysical Volume(1) = {1};\n"
                  "Mesh.MeshSizeExtendFromBoundary = 0;\nMesh.MeshSizeMin = %.9g;\nMesh.MeshSizeMax = %.9g;\n"
                  "Mesh.Algorithm = 6;\nMesh.Algorithm3D = 1;\nMesh.Optimize = 1;\nMesh.OptimizeThreshold = "
                  "0.5;\nMesh.Smoothing = 5;\n",
                  feature_angle_deg, size_m, size_m);
    return text;
}

// Last lines of gmsh's log that say what was wrong.
std::string complaint(const fs::path& log) {
    const auto text = read_text_file(log);
    std::string out;
    TextCursor lines(text ? std::string_view(*text) : std::string_view());
    while (const auto line = lines.next_line())
        if (line->find("Error") != std::string_view::npos && out.size() < 300 &&
            line->find("---") == std::string_view::npos)
            out += (out.empty() ? "" : "; ") + std::string(line->substr(std::min<std::size_t>(10, line->size())));
    return out.empty() ? "no reason given" : out;
}

Result<TetMeshData> run_gmsh(const fs::path& folder, const std::string& name) {
    const std::string geo = (folder / "mesh.geo").string(), out = (folder / "mesh.vtk").string(),
                      log = (folder / "log").string();
    std::vector<std::string> words{"gmsh", "-3", "-nt", "1", "-v", "3", "-format", "vtk", "-o", out, geo};
    std::vector<char*> argv;
    for (auto& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&files, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    posix_spawn_file_actions_adddup2(&files, 1, 2);
    pid_t child = 0;
    const int failed = posix_spawnp(&child, "gmsh", &files, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    if (failed != 0) return host_fault("program 'gmsh' cannot be started: apt-get install gmsh");
    int status = 0;
    waitpid(child, &status, 0);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || !fs::exists(out))
        return not_usable(name + ": gmsh made no mesh: " + complaint(log));
    auto mesh = read_vtk_tets(out);
    if (!mesh) return not_usable(name + ": gmsh made no usable mesh: " + mesh.error().text);
    return mesh;
}

// gmsh saves nodes of curves too; only those of tetrahedra stay.
void drop_unused_nodes(TetMeshData& mesh) {
    std::vector<std::int32_t> index(mesh.nodes.size(), -1);
    std::vector<Point> nodes;
    for (auto& tet : mesh.tets)
        for (auto& node : tet) {
            auto& to = index[static_cast<std::size_t>(node)];
            if (to < 0) {
                to = static_cast<std::int32_t>(nodes.size());
                nodes.push_back(mesh.nodes[static_cast<std::size_t>(node)]);
            }
            node = to;
        }
    mesh.nodes = std::move(nodes);
    mesh.region.clear();
}

}  // namespace

MeshQuality measure_quality(const TetMeshData& mesh) {
    MeshQuality q;
    std::vector<double> ratios;
    q.min_dihedral_deg = 180.0;
    double edges = 0.0;
    for (const auto& tet : mesh.tets) {
        std::array<Vector3d, 4> x;
        for (std::size_t k = 0; k < 4; ++k) x[k] = vector(mesh.nodes[static_cast<std::size_t>(tet[k])]);
        const Vector3d a = x[1] - x[0], b = x[2] - x[0], c = x[3] - x[0];
        const double six_volumes = std::abs(a.cross(b).dot(c));
        q.volume_m3 += six_volumes / 6.0;
        // r = 3 V / A, R = |a^2 (b x c) + b^2 (c x a) + c^2 (a x b)| / (12 V)
        const double R =
            (a.squaredNorm() * b.cross(c) + b.squaredNorm() * c.cross(a) + c.squaredNorm() * a.cross(b)).norm() /
            (2.0 * six_volumes);
        const double area =
            0.5 * (a.cross(b).norm() + b.cross(c).norm() + c.cross(a).norm() + (b - a).cross(c - a).norm());
        ratios.push_back(3.0 * (0.5 * six_volumes / area) / R);
        for (std::size_t i = 0; i < 4; ++i)
            for (std::size_t j = i + 1; j < 4; ++j) {
                std::array<std::size_t, 2> other{};
                std::size_t n = 0;
                for (std::size_t k = 0; k < 4; ++k)
                    if (k != i && k != j) other[n++] = k;
                const Vector3d e = (x[j] - x[i]).normalized();
                const auto off = [&](std::size_t k) {
                    const Vector3d d = x[k] - x[i];
                    return Vector3d(d - d.dot(e) * e);
                };
                const Vector3d u = off(other[0]), v = off(other[1]);
                const double angle = std::atan2(u.cross(v).norm(), u.dot(v)) * 180.0 / std::numbers::pi;
                q.min_dihedral_deg = std::min(q.min_dihedral_deg, angle);
                q.max_dihedral_deg = std::max(q.max_dihedral_deg, angle);
                edges += (x[j] - x[i]).norm() / 6.0;
            }
    }
    std::sort(ratios.begin(), ratios.end());
    const auto n = static_cast<double>(ratios.size());
    q.min_ratio = ratios.front();
    q.p5_ratio = ratios[static_cast<std::size_t>(0.05 * n)];
    q.mean_ratio = std::accumulate(ratios.begin(), ratios.end(), 0.0) / n;
    q.edge_m = edges / n;
    return q;
}

Result<TetMeshing> mesh_surface(const TriangleSurface& surface, const std::string& name, double unit_m,
                                const MeshingSettings& settings, const std::function<void(int, std::size_t)>& done) {
    if (const auto cut = ClosestPointSearch(surface).self_intersection())
        return invalid_input(name + ": the surface cuts itself: triangles " + std::to_string(cut->first) + " and " +
                             std::to_string(cut->second) + " at " + place_text(surface.corner(cut->first, 0), unit_m));
    std::string pattern = (fs::temp_directory_path() / "teres-mesh-XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) return host_fault(pattern + ": no scratch folder can be made");
    const ScratchFolder scratch{pattern};
    TERES_TRY(write_text_file(scratch.path / "surface.stl", stl_text(surface)));
    TetMeshing out;
    // a regular tetrahedron of edge h has h^3/(6 sqrt 2)
    out.size_m = std::cbrt(6.0 * std::numbers::sqrt2 * signed_volume(surface) / settings.num_tets);
    double size_m = out.size_m;
    std::size_t last_count = 0;
    for (int round = 1; round <= settings.max_rounds && out.quality.min_ratio < settings.good_ratio; ++round) {
        TERES_TRY(write_text_file(scratch.path / "mesh.geo", geometry_text(size_m, settings.feature_angle_deg)));
        TERES_TRY_ASSIGN(TetMeshData mesh, run_gmsh(scratch.path, name));
        last_count = mesh.tets.size();
        done(round, last_count);
        const double excess = static_cast<double>(last_count) / settings.num_tets;
        if (std::abs(excess - 1.0) > settings.tolerance) {
            size_m *= std::cbrt(excess);
            continue;
        }
        drop_unused_nodes(mesh);
        const MeshQuality quality = measure_quality(mesh);
        if (quality.min_ratio > out.quality.min_ratio) {
            out.mesh = std::move(mesh);
            out.quality = quality;
            out.size_m = size_m;
        }
        // a sliver: another size, towards the wanted number and a little past it, gives another surface mesh
        size_m *= std::cbrt(excess) * (excess < 1.0 ? 0.993 : 1.007);
    }
    if (out.mesh.tets.empty())
        return not_usable(name + ": " + std::to_string(last_count) + " tetrahedra after " +
                          std::to_string(settings.max_rounds) + " rounds, wanted " + std::to_string(settings.num_tets) +
                          " +- " + to_text(100.0 * settings.tolerance) + " %");
    TERES_TRY(check_body_mesh(out.mesh, name));
    const Surface boundary(out.mesh);
    for (Eigen::Index v = 0; v < surface.num_vertices(); ++v)
        out.surface_distance_m = std::max(
            out.surface_distance_m, boundary.closest({surface.V(0, v), surface.V(1, v), surface.V(2, v)}).distance_m);
    return out;
}

}  // namespace teres
