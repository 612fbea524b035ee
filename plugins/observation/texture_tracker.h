// Points of the liver's own texture through a film, where nobody put markers.
//
//   view      logarithm of the brightness less its local mean: lamp and shading hardly count
//   choose    at rest: corners (Shi & Tomasi 1994) on the liver, spread out, each lifted to 3-D: its rest position
//   carry     pyramidal Lucas-Kanade from the frame before, checked backwards
//   confirm   the same from the frame of the start, from where the flow ended: errors do not accumulate; a feature that
//   is not
//             confirmed for long is missing
//   find      a lost one is looked for, by its patch of the start, where its neighbours' displacement puts it
//   lift, verify   as markers (marker_tracker.h)
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "plugins/observation/marker_tracker.h"

namespace teres {

struct TextureOptions {
    int features = 60;
    double spacing_m = 0.008;            ///< least distance of two features
    double quality = 0.02;               ///< least corner response over the best one's
    double max_flow_error_px = 1.0;      ///< forward-backward
    double consistency_limit_m = 0.006;  ///< off the neighbours' prediction, or off in depth: rejected
    double neighbour_reach_m = 0.045;
};

struct Feature {
    Eigen::Vector3d rest = Eigen::Vector3d::Zero();  ///< case axes [m]
    MarkerSight sight;
};

class TextureTracker {
  public:
    /// pose: tracking camera -> case.
    TextureTracker(const CameraModel& camera, const Pose& pose, const TextureOptions& options)
        : camera_(camera), pose_(pose), to_camera_(pose.inverse()), options_(options) {}

    /// [loop] The frame at rest; range_m: distance of the liver's surface along the optical axis, 32-bit float, 0
    /// beside it. The number of a feature is its index. False: fewer than eight features.
    bool start(const cv::Mat& grey, const cv::Mat& range_m, const Lift& lift);
    /// [loop] One more frame.
    const std::vector<Feature>& track(const cv::Mat& grey, const Lift& lift);
    const std::vector<Feature>& features() const { return features_; }

  private:
    struct Track {
        Pixel start{}, pixel{};
        bool on_image = false;                           ///< pixel is from the frame before
        int unconfirmed = 0;                             ///< frames
        Eigen::Vector3d last = Eigen::Vector3d::Zero();  ///< newest position or prediction, case axes
    };
    struct Flow {
        std::vector<cv::Point2f> to;
        std::vector<bool> good;
    };
    Flow flow(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to, const std::vector<cv::Point2f>& points,
              const std::vector<cv::Point2f>& guess) const;
    void place(std::size_t i, const Lift& lift);
    void verify();
    std::vector<Neighbour> neighbours() const;

    CameraModel camera_;
    Pose pose_, to_camera_;
    TextureOptions options_;
    std::vector<Feature> features_;
    std::vector<Track> tracks_;
    std::vector<cv::Mat> first_, before_;  // pyramids
};

}  // namespace teres
