// The same dot in both images of a stereo pair: where its two rays meet.
//
//     z₁, z₂ minimise |z₁ r₁ - (t + z₂ R r₂)|;  the point lies midway;  σ_z = z² σ_px √2 / (f B)
#pragma once

#include <optional>
#include <vector>

#include "plugins/observation/lift.h"

namespace teres {

struct StereoPair {
    CameraModel left, right;
    Pose right_to_left;
};

struct MeetingOptions {
    double max_gap_m = 0.0005;     ///< between the rays
    double depth_gate_m = 0.03;    ///< about the guess
    double min_area_ratio = 0.75;  ///< smaller over larger area: less, and one of the two is partly hidden
    double unmistakable = 2.0;     ///< the second best dot must be this many times further from the guess
};

/// Nothing where the rays are parallel, meet behind a camera or pass each other further away than max_gap_m.
std::optional<LiftedPoint> triangulate(const StereoPair& pair, const Pixel& left, const Pixel& right,
                                       const LiftOptions& lift, double max_gap_m);

class StereoLift final : public Lift {
  public:
    /// right_dots: every dot of the right image; must outlive the lift.
    StereoLift(const StereoPair& pair, const std::vector<Blob>& right_dots, const LiftOptions& lift,
               const MeetingOptions& meeting)
        : pair_(pair), dots_(right_dots), lift_(lift), meeting_(meeting) {}
    std::optional<LiftedPoint> at(const Blob& dot, double guess_z_m) const override;

  private:
    StereoPair pair_;
    const std::vector<Blob>& dots_;
    LiftOptions lift_;
    MeetingOptions meeting_;
};

}  // namespace teres
