#include "tools/atlas/triangle_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <map>
#include <numeric>

#include "core/case/text_file.h"
#include "core/case/text_writer.h"

namespace teres {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

Vector3d double_area_normal(const TriangleSurface& s, std::size_t f) {
    return (s.corner(f, 1) - s.corner(f, 0)).cross(s.corner(f, 2) - s.corner(f, 0));
}

std::size_t root_of(std::vector<std::size_t>& parent, std::size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

}  // namespace

Result<double> unit_in_m(std::string_view unit) {
    if (unit == "m") return 1.0;
    if (unit == "cm") return 1e-2;
    if (unit == "mm") return 1e-3;
    return invalid_input("unit " + in_quotes(unit) + " is not known, expected m, cm or mm");
}

double signed_volume(const TriangleSurface& s) {
    double six = 0.0;
    const Vector3d origin = s.V.rowwise().mean();
    for (std::size_t f = 0; f < s.F.size(); ++f)
        six += (s.corner(f, 0) - origin).dot((s.corner(f, 1) - origin).cross(s.corner(f, 2) - origin));
    return six / 6.0;
}

VectorXd vertex_areas(const TriangleSurface& s) {
    VectorXd area = VectorXd::Zero(s.num_vertices());
    for (std::size_t f = 0; f < s.F.size(); ++f)
        for (const auto v : s.F[f]) area[v] += double_area_normal(s, f).norm() / 6.0;
    return area;
}

Matrix3Xd vertex_normals(const TriangleSurface& s) {
    Matrix3Xd normal = Matrix3Xd::Zero(3, s.num_vertices());
    for (std::size_t f = 0; f < s.F.size(); ++f)
        for (const auto v : s.F[f]) normal.col(v) += double_area_normal(s, f);
    for (Eigen::Index v = 0; v < normal.cols(); ++v) normal.col(v).normalize();
    return normal;
}

Vector3d area_centroid(const TriangleSurface& s) {
    const VectorXd area = vertex_areas(s);
    return s.V * area / area.sum();
}

std::string place_text(const Vector3d& place_m, double unit_m) {
    const Vector3d p = place_m / unit_m;
    char text[96];
    std::snprintf(text, sizeof text, "(%.4g, %.4g, %.4g) %s", p[0], p[1], p[2],
                  unit_m == 1.0 ? "m" : (unit_m == 1e-2 ? "cm" : "mm"));
    return text;
}

SurfaceDefects find_defects(const TriangleSurface& s) {
    SurfaceDefects out;
    const auto n = static_cast<std::size_t>(s.num_vertices());
    std::vector<std::size_t> parent(n), hole(n);
    std::iota(parent.begin(), parent.end(), std::size_t{0});
    hole = parent;
    std::vector<bool> used(n, false);
    struct Uses {
        int forward = 0, backward = 0;
    };
    std::map<std::pair<std::int32_t, std::int32_t>, Uses> edges;
    for (std::size_t f = 0; f < s.F.size(); ++f) {
        if (double_area_normal(s, f).norm() <= 0.0) ++out.num_degenerate;
        for (std::size_t k = 0; k < 3; ++k) {
            const auto a = s.F[f][k], b = s.F[f][(k + 1) % 3];
            used[static_cast<std::size_t>(a)] = true;
            (a < b ? edges[{a, b}].forward : edges[{b, a}].backward) += 1;
            parent[root_of(parent, static_cast<std::size_t>(a))] = root_of(parent, static_cast<std::size_t>(b));
        }
    }
    std::vector<std::size_t> border_vertices;
    for (const auto& [edge, uses] : edges) {
        const Vector3d middle = 0.5 * (s.V.col(edge.first) + s.V.col(edge.second));
        if (uses.forward + uses.backward == 1) {
            if (out.num_border_edges++ == 0) out.border = middle;
            const auto a = static_cast<std::size_t>(edge.first), b = static_cast<std::size_t>(edge.second);
            hole[root_of(hole, a)] = root_of(hole, b);
            border_vertices.push_back(a);
        } else if (uses.forward != 1 || uses.backward != 1) {
            if (out.num_folded_edges++ == 0) out.folded = middle;
        }
    }
    std::map<std::size_t, int> holes;
    for (const std::size_t v : border_vertices) ++holes[root_of(hole, v)];
    out.num_holes = holes.size();
    std::map<std::size_t, std::size_t> pieces;
    for (const auto& face : s.F) ++pieces[root_of(parent, static_cast<std::size_t>(face[0]))];
    for (const auto& [root, count] : pieces) out.component_triangles.push_back(count);
    std::sort(out.component_triangles.rbegin(), out.component_triangles.rend());
    out.num_components = static_cast<int>(pieces.size());
    out.num_unused_vertices = static_cast<std::size_t>(std::count(used.begin(), used.end(), false));
    return out;
}

Status check_closed(TriangleSurface& s, const std::string& name, double unit_m) {
    if (s.F.size() < 4)
        return invalid_input(name + ": " + std::to_string(s.F.size()) + " triangles, expected at least 4");
    const SurfaceDefects d = find_defects(s);
    if (d.num_components != 1)
        return invalid_input(name + ": the surface falls into " + std::to_string(d.num_components) + " components of " +
                             std::to_string(d.component_triangles[0]) + ", " +
                             std::to_string(d.component_triangles[1]) + (d.num_components > 2 ? ", ..." : "") +
                             " triangles, expected 1");
    if (d.num_border_edges > 0)
        return invalid_input(name + ": the surface is open: " + std::to_string(d.num_holes) + " hole(s), " +
                             std::to_string(d.num_border_edges) + " border edges, the first at " +
                             place_text(d.border, unit_m));
    if (d.num_folded_edges > 0)
        return invalid_input(name + ": " + std::to_string(d.num_folded_edges) +
                             " edges with more than two triangles or flipped neighbours, the first at " +
                             place_text(d.folded, unit_m));
    if (signed_volume(s) < 0.0)
        for (auto& face : s.F) std::swap(face[1], face[2]);
    return {};
}

std::size_t fill_small_holes(TriangleSurface& s, std::size_t max_edges) {
    std::map<std::pair<std::int32_t, std::int32_t>, int> uses;  // directed edges
    for (const auto& f : s.F)
        for (std::size_t k = 0; k < 3; ++k) ++uses[{f[k], f[(k + 1) % 3]}];
    std::map<std::int32_t, std::int32_t> next;  // along the border, against the triangles' direction
    for (const auto& [edge, count] : uses)
        if (!uses.contains({edge.second, edge.first})) next[edge.second] = edge.first;
    std::size_t filled = 0;
    while (!next.empty()) {
        std::vector<std::int32_t> loop{next.begin()->first};
        for (auto at = next.find(loop[0]); at != next.end(); at = next.find(loop.back())) {
            const std::int32_t to = at->second;
            next.erase(at);
            if (to == loop[0]) break;
            loop.push_back(to);
        }
        if (loop.size() < 3 || loop.size() > max_edges) continue;
        Vector3d middle = Vector3d::Zero();
        for (const auto v : loop) middle += s.V.col(v) / static_cast<double>(loop.size());
        const auto centre = static_cast<std::int32_t>(s.num_vertices());
        s.V.conservativeResize(3, centre + 1);
        s.V.col(centre) = middle;
        for (std::size_t k = 0; k < loop.size(); ++k) s.F.push_back({loop[k], loop[(k + 1) % loop.size()], centre});
        ++filled;
    }
    return filled;
}

Status write_obj(const TriangleSurface& s, const std::filesystem::path& file, const std::string& comment,
                 double unit_m) {
    std::string text = "# " + comment + "\n";
    char line[96];
    for (Eigen::Index v = 0; v < s.num_vertices(); ++v) {
        std::snprintf(line, sizeof line, "v %.6g %.6g %.6g\n", s.V(0, v) / unit_m, s.V(1, v) / unit_m,
                      s.V(2, v) / unit_m);
        text += line;
    }
    for (const auto& f : s.F)
        text +=
            "f " + std::to_string(f[0] + 1) + " " + std::to_string(f[1] + 1) + " " + std::to_string(f[2] + 1) + "\n";
    return write_text_file(file, text);
}

}  // namespace teres
