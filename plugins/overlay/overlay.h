// The hidden anatomy drawn over a colour frame: the liver's surface as a thin veil, the ligament's attachment
// probability as colour on it, and inner structures that ride on the tetrahedra, paler the deeper they lie.
//
//     pixel = (1 - α) camera + α colour,    α_inner = α₀ exp(-depth below the surface / fade)
//
// Hidden sides come from a z-buffer, so a structure behind the liver's outline is not drawn in front of a tool's place.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

#include "core/camera/camera_model.h"
#include "core/camera/z_buffer.h"
#include "core/case/case.h"
#include "core/result.h"

namespace teres {

struct OverlayOptions {
    double liver_opacity = 0.22;
    double ligament_opacity = 0.65;
    double inner_opacity = 0.9;
    double fade_m = 0.04;  ///< depth below the surface at which an inner structure has faded to 1/e
};

/// A point of an inner structure; neighbours in the list with the same name are joined.
struct StructurePoint {
    std::string name;
    Point rest_m{};
    double radius_m = 0.003;
};

/// `structure,x_m,y_m,z_m,radius_m`
Result<std::vector<StructurePoint>> read_structures(const std::filesystem::path& file);

class Overlay {
  public:
    Overlay(const TetMeshData& mesh, std::vector<StructurePoint> structures, const OverlayOptions& options);

    void set_camera(const CameraModel& camera, const Pose& camera_to_case);
    /// Of surface nodes; nodes not named keep none.
    void set_attachment(std::span<const std::int32_t> nodes, std::span<const double> probability);
    /// Positions of all nodes, case axes [m].
    void set_positions(std::span<const Point> nodes);
    void set_markers(std::vector<Point> markers) { markers_ = std::move(markers); }

    /// [loop] Draws onto an 8-bit BGR frame of the camera's size. stale: greyed, framed, and said so.
    void draw(cv::Mat& frame, bool stale);

  private:
    void veil(cv::Mat& frame, bool stale) const;
    void draw_structures(cv::Mat& frame, bool stale) const;
    void draw_markers(cv::Mat& frame) const;
    void embed(const TetMeshData& mesh);

    struct Carrier {
        std::array<std::int32_t, 4> nodes{};
        std::array<double, 4> weights{};
    };
    OverlayOptions options_;
    std::vector<std::array<std::int32_t, 3>> triangles_;
    std::vector<StructurePoint> structures_;
    std::vector<Carrier> carriers_;    // of structures_
    std::vector<double> probability_;  // of every node
    std::vector<Point> nodes_, markers_;
    CameraModel camera_;
    Pose to_camera_;
    ZBuffer buffer_{1, 1};
    std::vector<ZBuffer::Vertex> vertices_;
    struct Tint {
        int b, g, r, alpha;  // premultiplied by alpha (0..256)
    };
    std::vector<Tint> tints_;
};

}  // namespace teres
