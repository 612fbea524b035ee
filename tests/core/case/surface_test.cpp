#include "core/case/surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/case/geometry.h"
#include "tests/support/synthetic_case.h"

namespace teres {
namespace {

TEST(Surface, BlockBoundaryIsClosedAndFacesOutward) {
    const Point size{0.1, 0.03, 0.02};
    const TetMeshData mesh = test::block_mesh(size, {4, 3, 2});
    const Surface surface(mesh);
    double area = 0.0, volume = 0.0;
    for (const auto& [a, b, c] : surface.triangles()) {
        const Point &A = mesh.nodes[static_cast<std::size_t>(a)], &B = mesh.nodes[static_cast<std::size_t>(b)],
                    &C = mesh.nodes[static_cast<std::size_t>(c)];
        area += 0.5 * norm(cross(minus(B, A), minus(C, A)));
        volume += dot(A, cross(B, C)) / 6.0;  // divergence theorem: positive only if all face outward
    }
    EXPECT_NEAR(area, 2.0 * (size[0] * size[1] + size[0] * size[2] + size[1] * size[2]), 1e-12);
    EXPECT_NEAR(volume, size[0] * size[1] * size[2], 1e-12);
    // 5 x 4 x 3 nodes, of which 3 x 2 x 1 are inside
    EXPECT_EQ(surface.nodes().size(), 5u * 4u * 3u - 3u * 2u * 1u);
}

TEST(Surface, OrientationDoesNotDependOnTheOrderOfNodes) {
    TetMeshData mesh = test::block_mesh({0.1, 0.1, 0.1}, {2, 2, 2});
    for (std::size_t i = 0; i < mesh.tets.size(); i += 3) std::swap(mesh.tets[i][0], mesh.tets[i][1]);
    double volume = 0.0;
    const Surface surface(mesh);
    for (const auto& [a, b, c] : surface.triangles())
        volume += dot(mesh.nodes[static_cast<std::size_t>(a)],
                      cross(mesh.nodes[static_cast<std::size_t>(b)], mesh.nodes[static_cast<std::size_t>(c)])) /
                  6.0;
    EXPECT_NEAR(volume, 1e-3, 1e-12);
}

// Distance to a box has a closed form, inside and outside.
TEST(Surface, ClosestPointOfABlockMatchesTheClosedForm) {
    const Point size{0.1, 0.06, 0.04};
    const TetMeshData mesh = test::block_mesh(size, {5, 3, 2});
    const Surface surface(mesh);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> at(-0.05, 0.15);
    for (int i = 0; i < 2000; ++i) {
        const Point p{at(random), at(random), at(random)};
        double outside2 = 0.0, inside = 1e9;
        for (std::size_t k = 0; k < 3; ++k) {
            const double out = std::max({-p[k], 0.0, p[k] - size[k]});
            outside2 += out * out;
            inside = std::min({inside, p[k], size[k] - p[k]});
        }
        const double expected = outside2 > 0.0 ? std::sqrt(outside2) : inside;
        const SurfacePoint found = surface.closest(p);
        EXPECT_NEAR(found.distance_m, expected, 1e-12);
        EXPECT_NEAR(distance(found.position_m, p), expected, 1e-12);
        const auto& triangle = surface.triangles()[static_cast<std::size_t>(found.triangle)];
        Point by_weights{};
        for (std::size_t k = 0; k < 3; ++k) {
            EXPECT_GE(found.barycentric[k], 0.0);
            by_weights =
                plus(by_weights, times(found.barycentric[k], mesh.nodes[static_cast<std::size_t>(triangle[k])]));
        }
        EXPECT_NEAR(distance(by_weights, found.position_m), 0.0, 1e-12);
    }
    const SurfacePoint top = surface.closest({0.033, 0.021, 0.05});
    EXPECT_NEAR(top.normal[2], 1.0, 1e-12);
}

// Above 20,000 triangles the search goes through a grid; it must find what the whole search finds.
TEST(Surface, GridFindsWhatTheWholeSearchFinds) {
    const std::array<int, 3> cells{80, 70, 4};
    TetMeshData fine = test::block_mesh({0.2, 0.15, 0.01}, cells);
    for (Point& node : fine.nodes) node[2] += 0.03 * std::sin(20.0 * node[0]) * std::cos(15.0 * node[1]);
    const Surface with_grid(fine);
    ASSERT_GT(with_grid.triangles().size(), 20000u);
    std::mt19937 random(11);
    std::uniform_real_distribution<double> at(-0.1, 0.3);
    for (int i = 0; i < 60; ++i) {
        const Point p{at(random), at(random), at(random) - 0.1};
        double nearest = 1e9;
        for (const auto& [a, b, c] : with_grid.triangles()) {
            TetMeshData one;  // a sliver tetrahedron whose base is the triangle: its surface is searched whole
            const Point &A = fine.nodes[static_cast<std::size_t>(a)], &B = fine.nodes[static_cast<std::size_t>(b)],
                        &C = fine.nodes[static_cast<std::size_t>(c)];
            // cheap lower bound first: a triangle is within its longest edge of each corner
            const double reach = std::max({distance(A, B), distance(B, C), distance(C, A)});
            if (distance(p, A) - reach > nearest) continue;
            const Point n = cross(minus(B, A), minus(C, A));
            one.nodes = {A, B, C, plus(A, times(-1e-9 / norm(n), n))};
            one.tets = {{0, 2, 1, 3}};
            nearest = std::min(nearest, Surface(one).closest(p).distance_m);
        }
        EXPECT_NEAR(with_grid.closest(p).distance_m, nearest, 2e-9);
    }
}

TEST(Surface, NodeNormalsPointAwayFromTheMiddle) {
    const TetMeshData mesh = test::block_mesh({0.1, 0.1, 0.1}, {3, 3, 3});
    const Surface surface(mesh);
    const auto normals = surface.node_normals();
    ASSERT_EQ(normals.size(), surface.nodes().size());
    for (std::size_t i = 0; i < normals.size(); ++i) {
        const Point from_middle = minus(mesh.nodes[static_cast<std::size_t>(surface.nodes()[i])], {0.05, 0.05, 0.05});
        EXPECT_NEAR(norm(normals[i]), 1.0, 1e-12);
        EXPECT_GT(dot(normals[i], from_middle), 0.0);
    }
}

}  // namespace
}  // namespace teres
