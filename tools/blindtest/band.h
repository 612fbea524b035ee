// A ligament: a strip of the surface about an arc over the front of the liver, extruded along the outward normal, far
// edge fixed. True and believed ligament are both bands.
#pragma once

#include "core/case/case.h"

namespace teres::blindtest {

struct Band {
    Point axis_m{};       ///< a point of the axis along x about which the strip runs (its x is not used)
    double x0_m = 0.0;    ///< centre line at the middle of the arc
    double tilt_m = 0.0;  ///< drift of the centre line in x over the whole arc
    double width_m = 0.0;
    double theta0_deg = 0.0, theta1_deg = 0.0;  ///< from the front (0) to the top (90)
    double height_m = 0.0;
    double youngs_modulus_pa = 0.0, poissons_ratio = 0.0;

    bool contains(const Point& p) const;
    /// Smooth bell over the distance from the centre line that fades out at both ends of the arc; in [0, 0.97].
    double prior_probability(const Point& p) const;
    /// A point of the axis at the middle of the arc's centre line, and the direction outwards from it.
    Point middle_direction() const;

  private:
    double across_m(const Point& p) const;
    double theta_deg(const Point& p) const;
};

}  // namespace teres::blindtest
