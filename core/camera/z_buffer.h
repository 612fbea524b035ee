// Which triangle a camera sees at each pixel, and how far: the small software rasteriser behind phantom and overlay.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/camera/camera_model.h"

namespace teres {

class ZBuffer {
  public:
    /// A vertex on the image: z_m <= 0 hides every triangle that uses it (behind the camera, NaN).
    struct Vertex {
        float u = 0.0F, v = 0.0F, z_m = 0.0F;
    };

    ZBuffer(int width_px, int height_px);
    int width() const { return width_; }
    int height() const { return height_; }
    void clear();

    /// [loop] x_camera: pose maps the points into camera axes. Distortion acts on vertices only.
    static void project(std::span<const Point> points, const Pose& to_camera, const CameraModel& camera,
                        std::vector<Vertex>& out);
    /// [loop] Draws triangles seen from either side; ids count from first_id. cull: only counter-clockwise in the
    /// world seen from the camera (outward faces).
    void draw(std::span<const Vertex> vertices, std::span<const std::array<std::int32_t, 3>> triangles,
              std::int32_t first_id = 0, bool cull = false);

    /// -1: nothing
    std::int32_t id(int u, int v) const { return id_[index(u, v)]; }
    /// 0: nothing
    float z_m(int u, int v) const {
        const float inverse = inverse_z_[index(u, v)];
        return inverse > 0.0F ? 1.0F / inverse : 0.0F;
    }
    std::span<const std::int32_t> ids() const { return id_; }
    std::span<const float> inverse_z() const { return inverse_z_; }

    /// Perspective-correct weights of a triangle's vertices at a pixel.
    static std::array<double, 3> weights(const Vertex& a, const Vertex& b, const Vertex& c, double u, double v);

  private:
    std::size_t index(int u, int v) const {
        return static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(u);
    }
    void draw_one(const Vertex& a, const Vertex& b, const Vertex& c, std::int32_t id, bool cull);

    int width_, height_;
    std::vector<float> inverse_z_;  // 1/z is linear on the image
    std::vector<std::int32_t> id_;
};

}  // namespace teres
