#include "plugins/simulation/tet_mesh.h"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <map>
#include <string>

namespace teres {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// Faces of a positively oriented tetrahedron with outward normals.
constexpr int kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

std::vector<std::array<NodeIndex, 3>> boundary_triangles(const std::vector<std::array<NodeIndex, 4>>& tets) {
    std::map<std::array<NodeIndex, 3>, std::pair<int, std::array<NodeIndex, 3>>> faces;
    for (const auto& tet : tets)
        for (const auto& f : kFaces) {
            const std::array<NodeIndex, 3> face{tet[f[0]], tet[f[1]], tet[f[2]]};
            auto key = face;
            std::sort(key.begin(), key.end());
            auto& entry = faces[key];
            ++entry.first;
            entry.second = face;
        }
    std::vector<std::array<NodeIndex, 3>> surface;
    for (const auto& [key, entry] : faces)
        if (entry.first == 1) surface.push_back(entry.second);
    return surface;
}

// Closest point of triangle abc to p in barycentric coordinates (Ericson, Real-Time Collision
// Detection, 5.1.5).
Vector3d closest_barycentric(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    const Vector3d ab = b - a, ac = c - a, ap = p - a;
    const double d1 = ab.dot(ap), d2 = ac.dot(ap);
    if (d1 <= 0.0 && d2 <= 0.0) return {1, 0, 0};
    const Vector3d bp = p - b;
    const double d3 = ab.dot(bp), d4 = ac.dot(bp);
    if (d3 >= 0.0 && d4 <= d3) return {0, 1, 0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1 - d1 / (d1 - d3), d1 / (d1 - d3), 0};
    const Vector3d cp = p - c;
    const double d5 = ab.dot(cp), d6 = ac.dot(cp);
    if (d6 >= 0.0 && d5 <= d6) return {0, 0, 1};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1 - d2 / (d2 - d6), 0, d2 / (d2 - d6)};
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && (d4 - d3) >= 0.0 && (d5 - d6) >= 0.0) {
        const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0, 1 - w, w};
    }
    const double denominator = va + vb + vc;
    return {va / denominator, vb / denominator, vc / denominator};
}

}  // namespace

Result<TetMesh> TetMesh::make(const TetMeshData& data) {
    TetMesh mesh;
    const auto num_nodes = static_cast<Eigen::Index>(data.nodes.size());
    mesh.X.resize(3, num_nodes);
    for (Eigen::Index i = 0; i < num_nodes; ++i)
        mesh.X.col(i) = Eigen::Map<const Vector3d>(data.nodes[static_cast<std::size_t>(i)].data());
    mesh.tets = data.tets;
    mesh.node_volume.assign(data.nodes.size(), 0.0);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        const auto& t = mesh.tets[e];
        Matrix3d D;
        D << mesh.X.col(t[1]) - mesh.X.col(t[0]), mesh.X.col(t[2]) - mesh.X.col(t[0]),
            mesh.X.col(t[3]) - mesh.X.col(t[0]);
        const double volume = D.determinant() / 6.0;
        const double edge = D.colwise().norm().maxCoeff();
        if (!(volume > 1e-9 * edge * edge * edge))
            return invalid_input("tetrahedron " + std::to_string(e) + " is inverted or degenerate (volume " +
                                 std::to_string(volume * 1e9) + " mm^3)");
        const Matrix3d inverse = D.inverse();  // rows: gradients of N1, N2, N3
        Eigen::Matrix<double, 3, 4> g;
        g.rightCols<3>() = inverse.transpose();
        g.col(0) = -g.rightCols<3>().rowwise().sum();
        mesh.volume.push_back(volume);
        mesh.gradient.push_back(g);
        for (const auto node : t) mesh.node_volume[static_cast<std::size_t>(node)] += volume / 4.0;
    }
    mesh.surface = boundary_triangles(mesh.tets);
    mesh.node_normal.setZero(3, num_nodes);
    mesh.node_area.assign(data.nodes.size(), 0.0);
    for (const auto& f : mesh.surface) {
        const Vector3d n = 0.5 * (mesh.X.col(f[1]) - mesh.X.col(f[0])).cross(mesh.X.col(f[2]) - mesh.X.col(f[0]));
        for (std::size_t k = 0; k < 3; ++k) {
            mesh.node_normal.col(f[k]) += n;
            mesh.node_area[static_cast<std::size_t>(f[k])] += n.norm() / 3.0;
            mesh.longest_surface_edge_m =
                std::max(mesh.longest_surface_edge_m, (mesh.X.col(f[k]) - mesh.X.col(f[(k + 1) % 3])).norm());
        }
    }
    for (Eigen::Index i = 0; i < num_nodes; ++i) {
        const double length = mesh.node_normal.col(i).norm();
        if (length > 0.0) mesh.node_normal.col(i) /= length;
    }
    return mesh;
}

Embedding embed(const TetMesh& mesh, const Vector3d& point) {
    double best = -std::numeric_limits<double>::infinity();
    Embedding result;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        const auto& t = mesh.tets[e];
        Eigen::Vector4d w = mesh.gradient[e].transpose() * (point - mesh.X.col(t[0]));
        w(0) += 1.0;
        if (w.minCoeff() > best) {  // inside when all weights are >= 0; else the least extrapolation
            best = w.minCoeff();
            result.node = t;
            for (int i = 0; i < 4; ++i) result.weight[static_cast<std::size_t>(i)] = w(i);
            if (best >= 0.0) break;
        }
    }
    return result;
}

SurfaceRider ride(const TetMesh& mesh, const Vector3d& point) {
    double best = std::numeric_limits<double>::infinity();
    SurfaceRider rider;
    for (const auto& f : mesh.surface) {
        const Vector3d a = mesh.X.col(f[0]), b = mesh.X.col(f[1]), c = mesh.X.col(f[2]);
        const Vector3d w = closest_barycentric(point, a, b, c);
        const double distance = (point - (w(0) * a + w(1) * b + w(2) * c)).squaredNorm();
        if (distance >= best) continue;
        best = distance;
        rider.node = f;
        const Vector3d n = (b - a).cross(c - a).normalized();
        rider.offset_m = n.dot(point - a);
        // Weights of the foot point in the triangle's plane: the rest position is then met exactly.
        const Vector3d foot = point - rider.offset_m * n;
        const double area2 = n.dot((b - a).cross(c - a));
        rider.weight = {n.dot((b - foot).cross(c - foot)) / area2, n.dot((c - foot).cross(a - foot)) / area2,
                        n.dot((a - foot).cross(b - foot)) / area2};
    }
    return rider;
}

}  // namespace teres
