// What the phantom consists of: a liver that moves as an independent solver says (validation.csv of the case folder), a
// cloth band that holds it, a wooden frame, a table, and a retractor that sweeps in front.
//
// A breathing curve shifts liver, band and frame together; table, retractor, lamp and camera stay.
//
//     u(X) = A [1 X] + Σ_k c_k |X - X_k|³        polyharmonic spline through the true points: u(X_k) = x_k - X_k
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/camera/camera_model.h"
#include "core/case/case.h"
#include "core/case/surface.h"
#include "core/result.h"
#include "tools/phantom/respiration.h"

namespace teres::phantom {

enum class Material : std::uint8_t { kLiver, kCloth, kWood, kTable, kSteel };

/// Triangles with the positions they have now and at rest (which carry the texture).
struct Mesh {
    std::vector<Point> rest, now;
    std::vector<std::array<std::int32_t, 3>> triangles;
    std::vector<Material> material;  ///< one per triangle
};

struct SceneOptions {
    double occlusion = 0.0;       ///< share of the liver's width that the retractor covers, 0..0.9
    double sweep_period_s = 7.3;  ///< of the retractor, there and back
    double marker_radius_m = 0.003;
    std::optional<Respiration> respiration;
};

class Scene {
  public:
    /// Errors: no camera in the case, no validation.csv, fewer than two times or five points.
    static Result<Scene> make(const Case& c, const SceneOptions& options);

    /// Moves everything to time t [s] of the film; the liver goes to the end of its recording and back.
    void move_to(double t_s);
    double case_time(double t_s) const;
    const Mesh& mesh() const { return mesh_; }
    const Pose& camera() const { return camera_; }  ///< of the colour camera: camera -> case
    const SceneOptions& options() const { return options_; }

    struct Marker {
        std::int32_t id = 0, triangle = -1;
        std::array<double, 3> weights{};
        Point rest{};  ///< on the surface
    };
    const std::vector<Marker>& markers() const { return markers_; }
    Point marker_now(const Marker& marker) const;
    /// The case's true points, in the order of its validation_rest.
    const std::vector<Point>& points_now() const { return points_now_; }
    /// How far breathing has carried the phantom [m].
    const Point& shift_now() const { return shift_now_; }

  private:
    Status read_motion(const Case& c);
    void add_band(const Case& c, const Surface& surface);
    void add_box(const Point& low, const Point& high, Material material);
    void add_retractor();
    void move_retractor(double t_s);

    SceneOptions options_;
    Mesh mesh_;
    Pose camera_;
    std::vector<Marker> markers_;
    std::vector<std::int32_t> surface_nodes_;       // vertices of mesh_ that move with the liver
    std::vector<double> times_;                     // of the trajectories
    std::vector<std::vector<Point>> trajectories_;  // [time][surface node]
    std::vector<std::vector<Point>> points_;        // [time][true point]
    std::vector<Point> points_now_;
    Point shift_now_{};
    std::size_t table_begin_ = 0;      // vertex; those before it breathe
    std::size_t retractor_begin_ = 0;  // vertex
    Point low_{}, high_{};             // box of the liver at rest
};

}  // namespace teres::phantom
