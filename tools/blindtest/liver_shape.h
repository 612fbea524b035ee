// A liver-like body drawn at random: a smooth union of ellipsoids (lobes, dome, bridge) less a visceral hollow.
// Frame: x to the patient's left, y up (cranial), z to the front; metres; origin at the centre of the lobes.
#pragma once

#include <array>
#include <vector>

#include "core/case/case.h"
#include "tools/blindtest/body_shape.h"
#include "tools/blindtest/random.h"

namespace teres::blindtest {

class LiverShape : public BodyShape {
  public:
    /// Draws sizes and places of the parts about those of an adult's liver.
    explicit LiverShape(Random& random);

    double level(const Point& p) const override;
    Point centre() const override { return kCentre; }
    std::pair<Point, Point> box() const override { return {{-0.14, -0.12, -0.11}, {0.14, 0.12, 0.11}}; }
    double scale() const override { return scale_; }

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
