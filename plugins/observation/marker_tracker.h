// Markers through a film: where each is, which is which, and which cannot be told.
//
//   1. flow      pyramidal Lucas-Kanade from the frame before, checked backwards, carries every seen marker on
//   2. detect    dots of this frame; the one at the flow's end is the marker (sub-pixel centre of the dot)
//   3. find      a lost marker is looked for where its neighbours say it must be (rest shape, affine, plus how far it
//                stood off that prediction when last seen); only an unmistakable dot is taken
//   4. lift      3-D from depth or stereo; a dot that is partly hidden, or without depth, is missing
//   5. verify    each against its neighbours' prediction: exchanged identities are set right, strays are rejected
//
// Identity hangs on the rest shape, not on the frame before, so that errors do not accumulate.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/camera/camera_model.h"
#include "plugins/observation/blob_detector.h"
#include "plugins/observation/lift.h"
#include "plugins/observation/shape_prediction.h"

namespace teres {

struct TrackerOptions {
    bool bright = false;
    double diameter_m = 0.006;
    double contrast = 1.8;               ///< brightness ratio
    double start_gate_m = 0.015;         ///< search radius around the rest shape before anything is known
    double find_gate_m = 0.006;          ///< search radius around the neighbours' prediction
    double consistency_limit_m = 0.006;  ///< change of the offset from the neighbours' prediction
    double neighbour_reach_m = 0.045;    ///< L
    double max_flow_error_px = 1.0;      ///< forward-backward
    double min_area_ratio = 0.75;        ///< of a dot's area over that in full view: less is partly hidden
};

enum class MarkerStatus : std::int8_t { kRejected = -1, kMissing = 0, kTracked = 1, kFound = 2 };

struct MarkerSight {
    MarkerStatus status = MarkerStatus::kMissing;
    Pixel pixel{};
    Eigen::Vector3d x = Eigen::Vector3d::Zero();           ///< case axes [m]
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< [m²]
    bool seen() const { return status > MarkerStatus::kMissing; }
};

class MarkerTracker {
  public:
    /// rest: positions in case axes [m]; pose: tracking camera -> case.
    MarkerTracker(std::vector<Eigen::Vector3d> rest, const CameraModel& camera, const Pose& pose,
                  const TrackerOptions& options);

    /// [loop] One frame, 8-bit grey of the camera's size.
    const std::vector<MarkerSight>& track(const cv::Mat& grey, const Lift& lift);
    const std::vector<MarkerSight>& sights() const { return sights_; }
    double mean_z_m() const;  ///< of the markers, newest positions or predictions
    std::int64_t swaps() const { return swaps_; }
    std::int64_t rejected() const { return rejected_; }

  private:
    struct Track {
        Eigen::Vector3d rest, offset = Eigen::Vector3d::Zero();  ///< offset: from the neighbours' prediction, slow mean
        bool known = false;                                      ///< offset and area have been seen
        bool on_image = false;                                   ///< pixel is from the frame before
        Pixel pixel{};
        double area_ratio = 0.0;  ///< dot's area over (focal diameter / z)²
        int found_frames = 0;     ///< since it was found
    };
    struct Expected {
        Pixel pixel;
        double z_m, gate_px;
    };

    void carry_by_flow(const std::vector<cv::Mat>& pyramid);
    void detect(const cv::Mat& grey);
    void claim_carried(const Lift& lift);
    void find_lost(const Lift& lift);
    void take(std::size_t marker, const Blob& blob, double guess_z_m, double gate_m, const Lift& lift, MarkerStatus as);
    void verify();
    void mend_swaps();
    void remember();
    void reject(std::size_t marker);

    std::vector<Neighbour> neighbours() const;
    std::optional<Eigen::Vector3d> predict(const std::vector<Neighbour>& from, std::size_t marker) const;
    std::optional<Expected> expect(const Eigen::Vector3d& x, double gate_m) const;
    double z_of(const Eigen::Vector3d& x) const;

    CameraModel camera_;
    Pose pose_, to_camera_;
    TrackerOptions options_;
    std::vector<Track> tracks_;
    std::vector<MarkerSight> sights_;
    std::vector<Eigen::Vector3d> last_;  ///< newest position or prediction, case axes
    std::vector<cv::Mat> pyramid_;
    std::vector<Blob> blobs_;
    std::vector<bool> claimed_;
    std::int64_t swaps_ = 0, rejected_ = 0;
};

}  // namespace teres
