// A liver-like body drawn at random: a smooth union of ellipsoids (lobes, dome, bridge) less a visceral hollow.
// Frame: x to the patient's left, y up (cranial), z to the front; metres; origin at the centre of the lobes.
#pragma once

#include <array>
#include <vector>

#include "core/case/case.h"
#include "tools/blindtest/random.h"

namespace teres::blindtest {

class LiverShape {
  public:
    /// Draws sizes and places of the parts about those of an adult's liver.
    explicit LiverShape(Random& random);

    /// Negative inside, positive outside, about the distance near the surface [m].
    double level(const Point& p) const;
    /// Outward unit normal of the level set through p (differences).
    Point normal(const Point& p) const;
    /// Where the ray from `origin` (inside) along `direction` leaves the body.
    Point exit(const Point& origin, const Point& direction) const;
    Point centre() const { return kCentre; }
    double scale() const { return scale_; }

  private:
    struct Ellipsoid {
        Point centre_m{}, semi_axes_m{};
        double level(const Point& p) const;
    };
    static constexpr Point kCentre{0.0, 0.028, 0.004};

    std::vector<Ellipsoid> parts_;
    Ellipsoid hollow_;
    double scale_ = 1.0;
};

}  // namespace teres::blindtest
