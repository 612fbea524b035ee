#include "tools/bench_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/case/surface.h"

namespace teres::tools {
namespace {

// Cubes of a lattice, six tetrahedra each around the diagonal (Kuhn), on [-1, 1]^3.
TetMeshData lattice(int n) {
    TetMeshData mesh;
    for (int i = 0; i <= n; ++i)
        for (int j = 0; j <= n; ++j)
            for (int k = 0; k <= n; ++k)
                mesh.nodes.push_back({2.0 * i / n - 1.0, 2.0 * j / n - 1.0, 2.0 * k / n - 1.0});
    constexpr int kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            for (int k = 0; k < n; ++k)
                for (int o = 0; o < 6; ++o) {
                    std::array<int, 3> at{i, j, k};
                    std::array<std::int32_t, 4> tet{};
                    for (std::size_t corner = 0; corner < 4; ++corner) {
                        tet[corner] = (at[0] * (n + 1) + at[1]) * (n + 1) + at[2];
                        if (corner < 3) ++at[static_cast<std::size_t>(kOrders[o][corner])];
                    }
                    if (o >= 3) std::swap(tet[2], tet[3]);
                    mesh.tets.push_back(tet);
                }
    return mesh;
}

// Cube to ball, half way (corners stay soft), then to the size and taper of a liver. x to the patient's left.
Point liver_shape(const Point& p) {
    const double x2 = p[0] * p[0], y2 = p[1] * p[1], z2 = p[2] * p[2];
    Point ball{p[0] * std::sqrt(1.0 - y2 / 2.0 - z2 / 2.0 + y2 * z2 / 3.0),
               p[1] * std::sqrt(1.0 - z2 / 2.0 - x2 / 2.0 + z2 * x2 / 3.0),
               p[2] * std::sqrt(1.0 - x2 / 2.0 - y2 / 2.0 + x2 * y2 / 3.0)};
    for (std::size_t a = 0; a < 3; ++a) ball[a] = 0.7 * ball[a] + 0.3 * p[a];
    const double taper = 1.0 - 0.35 * ball[0];  // thinner to the left
    return {0.10 * ball[0], 0.075 * taper * ball[1], 0.055 * taper * ball[2]};
}

}  // namespace

Case bench_case(const BenchScene& scene) {
    Case c;
    c.name = "bench";
    c.frame = "x to the patient's left, y up (cranial), z to the front";
    c.num_frames = scene.frames;
    c.dt_s = 1.0 / scene.rate_hz;
    c.body.law = scene.law;
    c.body.youngs_modulus_pa = scene.youngs_modulus_pa;
    c.body.poissons_ratio = scene.poissons_ratio;
    c.body.shear_modulus_pa = scene.youngs_modulus_pa / (2.0 * (1.0 + scene.poissons_ratio));
    c.body.bulk_modulus_pa = scene.youngs_modulus_pa / (3.0 * (1.0 - 2.0 * scene.poissons_ratio));
    c.body.alpha = 0.88;
    c.body.density_kg_m3 = 1060.0;
    c.ligament = LigamentData{scene.ligament, 100e3, 0.48, 0.025, 0.02, 0.0};
    c.sensor.noise_sigma_m = 3e-4;

    const int n = std::max(2, static_cast<int>(std::lround(std::cbrt(scene.tetrahedra / 6.0))));
    c.mesh = lattice(n);
    LoadRegion right{"right_lobe", {}, {}}, left{"left_lobe", {}, {}};
    std::vector<std::int32_t> front;
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i) {
        const Point cube = c.mesh.nodes[i];
        c.mesh.nodes[i] = liver_shape(cube);
        const auto id = static_cast<std::int32_t>(i);
        const double cell = 2.0 / n;
        if (cube[1] > 1.0 - 1e-9) {  // strip over the top: sure in the middle, doubtful at its ends
            const double across = std::abs(cube[2]) / 0.45, along = std::abs(cube[0]);
            if (across < 1.0) c.ligament_prior.push_back({id, 0.9 * (1.0 - 0.5 * across) * (along < 0.7 ? 1.0 : 0.5)});
        }
        if (cube[2] < -1.0 + 1e-9 && std::abs(cube[0] + 0.2) < 0.2 + cell / 2.0 && std::abs(cube[1]) < 0.4 + cell / 2.0)
            c.clamped.push_back(id);  // around the vena cava
        if (cube[1] < -1.0 + 1e-9 && std::abs(cube[2]) < 0.3 + cell) {
            auto& region = cube[0] < 0.0 ? right : left;
            if (std::abs(std::abs(cube[0]) - 0.6) < 0.2 + cell / 2.0) region.node_ids.push_back(id);
        }
        if (cube[2] > 1.0 - 1e-9 && std::abs(cube[0]) < 0.95 && std::abs(cube[1]) < 0.95) front.push_back(id);
    }
    for (auto* region : {&right, &left})
        region->weights.assign(region->node_ids.size(), 1.0 / static_cast<double>(region->node_ids.size()));
    c.load_regions = {right, left};
    for (int f = 0; f < scene.frames; ++f) {
        const double t = f * c.dt_s, w = 2.0 * std::numbers::pi;
        const double a = scene.peak_force_n * (0.5 + 0.5 * std::sin(w * t / 3.1)),
                     b = scene.peak_force_n * (0.5 - 0.5 * std::cos(w * t / 4.7));
        c.loads.push_back({t, 0, {0.3 * a, -a, 0.4 * a * std::cos(w * t / 7.3)}});
        c.loads.push_back({t, 1, {-0.2 * b, -0.8 * b, 0.5 * b}});
    }
    const auto count = static_cast<std::size_t>(scene.markers);
    for (std::size_t m = 0; m < count; ++m)
        c.markers.push_back({static_cast<std::int32_t>(m),
                             c.mesh.nodes[static_cast<std::size_t>(front[m * (front.size() - 1) / (count - 1)])]});
    return c;
}

}  // namespace teres::tools
