// Colour and distance images of the scene: z-buffer, lamp with shadow, procedural textures that stick to the material.
#pragma once

#include <opencv2/core.hpp>

#include "core/camera/camera_model.h"
#include "core/camera/z_buffer.h"
#include "tools/phantom/scene.h"

namespace teres::phantom {

struct Look {
    bool bright_markers = false;  ///< else dark
    bool no_markers = false;      ///< texture only
    double texture = 1.0;         ///< contrast of the liver's own texture
    double pixel_noise = 2.0;     ///< standard deviation [grey levels]
};

class Renderer {
  public:
    Renderer(const Scene& scene, const Look& look, std::uint64_t seed);

    /// Normals and shadow map of the scene as it stands; before the views of a moment.
    void begin_frame();
    /// 8-bit BGR. `camera_pose`: camera -> case.
    cv::Mat color(const CameraModel& camera, const Pose& camera_pose);
    /// Distance along the optical axis [m], 32-bit float; 0: nothing.
    cv::Mat range(const CameraModel& camera, const Pose& camera_pose);
    /// Whether the camera of the last view sees a point of the surface.
    bool sees(const Point& x) const;

  private:
    struct Surfel {
        Material material;
        Point rest, now, normal;
        std::int32_t triangle;
    };
    void raster(const CameraModel& camera, const Pose& camera_pose);
    Surfel surfel(int u, int v) const;
    cv::Vec3d albedo(const Surfel& s) const;
    double lit(const Surfel& s) const;

    const Scene& scene_;
    Look look_;
    cv::RNG random_;
    std::vector<std::vector<std::int32_t>> markers_near_;  // of each liver triangle
    std::vector<Point> normals_;                           // of each vertex
    CameraModel camera_, lamp_camera_;
    Pose to_camera_, to_lamp_;
    Point lamp_{};
    ZBuffer buffer_, shadow_;
    std::vector<ZBuffer::Vertex> vertices_, lamp_vertices_;
};

}  // namespace teres::phantom
