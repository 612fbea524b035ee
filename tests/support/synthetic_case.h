// A small case of our own making: a block of tetrahedra along x, clamped at x = 0, loaded at the far face.
//
//     Case c = teres::test::clamped_block({.cells = {8, 2, 2}});
//     ASSERT_TRUE(write_case(c, scratch.path()));
#pragma once

#include <array>
#include <functional>

#include "core/case/case.h"
#include "core/case/geometry.h"
#include "core/case/surface.h"

namespace teres::test {

/// Regular block [0, size] of `cells` boxes, six tetrahedra each (Kuhn: all share the box's main diagonal, so
/// that neighbouring boxes match). Node (i, j, k) is number (i (ny + 1) + j)(nz + 1) + k.
inline TetMeshData block_mesh(const Point& size_m, const std::array<int, 3>& cells) {
    TetMeshData mesh;
    const auto [nx, ny, nz] = cells;
    for (int i = 0; i <= nx; ++i)
        for (int j = 0; j <= ny; ++j)
            for (int k = 0; k <= nz; ++k)
                mesh.nodes.push_back({size_m[0] * i / nx, size_m[1] * j / ny, size_m[2] * k / nz});
    const std::array<std::array<int, 3>, 6> orders{{{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}};
    for (int i = 0; i < nx; ++i)
        for (int j = 0; j < ny; ++j)
            for (int k = 0; k < nz; ++k)
                for (std::size_t o = 0; o < orders.size(); ++o) {
                    std::array<int, 3> at{i, j, k};
                    std::array<std::int32_t, 4> tet{};
                    for (std::size_t corner = 0; corner < 4; ++corner) {
                        tet[corner] = (at[0] * (ny + 1) + at[1]) * (nz + 1) + at[2];
                        if (corner < 3) ++at[static_cast<std::size_t>(orders[o][corner])];
                    }
                    if (o >= 3) std::swap(tet[2], tet[3]);  // odd permutations are left-handed
                    mesh.tets.push_back(tet);
                }
    return mesh;
}

struct BlockOptions {
    Point size_m{0.10, 0.03, 0.03};
    std::array<int, 3> cells{10, 3, 3};
    BodyLaw law = BodyLaw::kStVK;
    double youngs_modulus_pa = 20e3;
    double poissons_ratio = 0.45;
    int frames = 5;
    double dt_s = 0.1;
    bool quasi_static = true;
    Point full_force_n{0.0, 0.0,
                       -0.1};  ///< on region "tip", grows linearly from 0 at the first to full at the last frame
    /// Where a material point (rest position) is at time t; observations and truth follow it. Default: at
    /// rest.
    std::function<Point(const Point& rest_m, double t_s)> motion{};
};

/// Markers on the top face, validation points inside, no ligament, no gravity, noise sigma 0.3 mm
/// (observations are exact; add noise where it matters).
inline Case clamped_block(const BlockOptions& options = {}) {
    Case c;
    c.name = "clamped block";
    c.frame = "x along the block, clamped at x = 0; z up";
    c.num_frames = options.frames;
    c.dt_s = options.dt_s;
    c.quasi_static = options.quasi_static;
    c.body.law = options.law;
    const double E = options.youngs_modulus_pa, nu = options.poissons_ratio;
    c.body.youngs_modulus_pa = E;
    c.body.poissons_ratio = nu;
    if (options.law == BodyLaw::kOgden) {
        c.body.shear_modulus_pa = E / (2.0 * (1.0 + nu));
        c.body.bulk_modulus_pa = E / (3.0 * (1.0 - 2.0 * nu));
        c.body.alpha = 2.0;
    }
    c.body.density_kg_m3 = 1060.0;
    c.sensor.noise_sigma_m = 3e-4;
    c.mesh = block_mesh(options.size_m, options.cells);

    const double far_m = options.size_m[0];
    for (std::size_t node = 0; node < c.mesh.nodes.size(); ++node)
        if (c.mesh.nodes[node][0] == 0.0) c.clamped.push_back(static_cast<std::int32_t>(node));

    // nodes of the far face, weighted by a third of the area of their triangles
    std::vector<double> weight(c.mesh.nodes.size(), 0.0);
    const auto position = [&](std::int32_t id) -> const Point& { return c.mesh.nodes[static_cast<std::size_t>(id)]; };
    const Surface surface(c.mesh);
    for (const auto& [a, b, d] : surface.triangles()) {
        if (position(a)[0] != far_m || position(b)[0] != far_m || position(d)[0] != far_m) continue;
        const double area = 0.5 * norm(cross(minus(position(b), position(a)), minus(position(d), position(a))));
        for (const std::int32_t id : {a, b, d})
            weight[static_cast<std::size_t>(id)] += area / 3.0 / (options.size_m[1] * options.size_m[2]);
    }
    c.load_regions.push_back({"tip", {}, {}});
    for (std::size_t node = 0; node < weight.size(); ++node) {
        if (weight[node] == 0.0) continue;
        c.load_regions[0].node_ids.push_back(static_cast<std::int32_t>(node));
        c.load_regions[0].weights.push_back(weight[node]);
    }

    for (const double x : {0.3, 0.5, 0.7, 0.9})
        for (const double y : {0.25, 0.75}) {
            const auto id = static_cast<std::int32_t>(c.markers.size());
            c.markers.push_back({id, {x * options.size_m[0], y * options.size_m[1], options.size_m[2]}});
            c.validation_rest.push_back({id, {x * options.size_m[0], y * options.size_m[1], 0.4 * options.size_m[2]}});
        }
    for (int frame = 0; frame < options.frames; ++frame) {
        const double t_s = frame * options.dt_s;
        const double share = options.frames > 1 ? static_cast<double>(frame) / (options.frames - 1) : 1.0;
        c.loads.push_back({t_s, 0, times(share, options.full_force_n)});
        for (const MarkerRest& marker : c.markers)
            c.observations.push_back(
                {t_s, marker.id, options.motion ? options.motion(marker.position_m, t_s) : marker.position_m});
    }
    return c;
}

/// True positions of the validation points under options.motion: what validation.csv holds.
inline std::vector<PositionSample> block_truth(const Case& c, const BlockOptions& options) {
    std::vector<PositionSample> truth;
    for (int frame = 0; frame < c.num_frames; ++frame)
        for (const MarkerRest& point : c.validation_rest) {
            const double t_s = frame * c.dt_s;
            truth.push_back({t_s, point.id, options.motion ? options.motion(point.position_m, t_s) : point.position_m});
        }
    return truth;
}

/// A clamped block that hangs on a ligament where it was clamped, but for an edge (y = 0) that stays clamped.
inline Case hung_on_ligament(Case c) {
    c.ligament = LigamentData{LigamentLaw::kNeoHookean, 50e3, 0.45, 0.02, 0.04, 0.0};
    std::vector<std::int32_t> edge;
    for (const std::int32_t node : c.clamped)
        if (c.mesh.nodes[static_cast<std::size_t>(node)][1] == 0.0)
            edge.push_back(node);
        else
            c.ligament_prior.push_back({node, 0.7});
    c.clamped = edge;
    return c;
}

}  // namespace teres::test
