#include "core/camera/z_buffer.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teres {
namespace {

using Triangles = std::vector<std::array<std::int32_t, 3>>;
const CameraModel kCamera{160, 120, 150.0, 150.0, 79.5, 59.5, {}};

// A tilted plane z = 0.3 + 0.5 x: on the ray (u, v) it lies at z = 0.3 / (1 - 0.5 (u - cx) / fx).
TEST(ZBuffer, DepthOfATiltedPlaneIsExact) {
    const std::vector<Point> x{{-0.3, -0.3, 0.15}, {0.3, -0.3, 0.45}, {0.3, 0.3, 0.45}, {-0.3, 0.3, 0.15}};
    ZBuffer buffer(160, 120);
    std::vector<ZBuffer::Vertex> vertices;
    ZBuffer::project(x, {}, kCamera, vertices);
    buffer.draw(vertices, Triangles{{0, 1, 2}, {0, 2, 3}});
    for (int v = 0; v < 120; v += 7)
        for (int u = 0; u < 160; u += 7)
            EXPECT_NEAR(buffer.z_m(u, v), 0.3 / (1.0 - 0.5 * (u - 79.5) / 150.0), 1e-5) << u << " " << v;
}

TEST(ZBuffer, NearerTriangleHidesAndBackFacesAreCulled) {
    const std::vector<Point> x{{-1, -1, 1},  {1, -1, 1},  {0, 1, 1}, {-1, -1, 0.5},
                               {1, -1, 0.5}, {0, 1, 0.5}, {0, 0, -1}};
    ZBuffer buffer(160, 120);
    std::vector<ZBuffer::Vertex> vertices;
    ZBuffer::project(x, {}, kCamera, vertices);
    for (const Triangles& order : {Triangles{{0, 1, 2}, {3, 4, 5}}, Triangles{{3, 4, 5}, {0, 1, 2}}}) {
        buffer.clear();
        buffer.draw(vertices, order);
        EXPECT_NEAR(buffer.z_m(80, 60), 0.5, 1e-6);
    }
    // In camera axes (y down) 0-1-2 turns clockwise as the camera sees it: a back face.
    buffer.clear();
    buffer.draw(vertices, Triangles{{0, 1, 2}}, 0, true);
    EXPECT_EQ(buffer.id(80, 60), -1);
    buffer.draw(vertices, Triangles{{0, 2, 1}}, 4, true);
    EXPECT_EQ(buffer.id(80, 60), 4);
    buffer.draw(vertices, Triangles{{0, 1, 6}}, 9);  // a vertex behind the camera
    EXPECT_EQ(buffer.id(80, 60), 4);
}

}  // namespace
}  // namespace teres
