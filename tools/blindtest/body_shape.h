// The form of a body, drawn or given, as a level function.
#pragma once

#include <utility>
#include <vector>

#include "core/case/case.h"
#include "core/case/surface.h"

namespace teres::blindtest {

class BodyShape {
  public:
    virtual ~BodyShape() = default;
    /// Negative inside, positive outside, about the distance near the surface [m].
    virtual double level(const Point& p) const = 0;
    /// Well inside the body.
    virtual Point centre() const = 0;
    /// Corners of a box that holds the body [m].
    virtual std::pair<Point, Point> box() const = 0;
    /// Size over that of an adult's liver.
    virtual double scale() const = 0;

    /// Outward unit normal of the level set through p (differences).
    Point normal(const Point& p) const;
    /// Where the ray from `origin` (inside) along the unit vector `direction` first leaves the body.
    Point exit(const Point& origin, const Point& direction) const;
};

/// The body of a given mesh.
class MeshShape : public BodyShape {
  public:
    explicit MeshShape(const TetMeshData& mesh);

    double level(const Point& p) const override;
    Point centre() const override { return centre_; }
    std::pair<Point, Point> box() const override { return {low_, high_}; }
    double scale() const override { return scale_; }
    const Surface& surface() const { return surface_; }

  private:
    Surface surface_;
    std::vector<Point> normals_;  // per node of the mesh; zero inside
    Point centre_{}, low_{}, high_{};
    double scale_ = 1.0;
};

}  // namespace teres::blindtest
