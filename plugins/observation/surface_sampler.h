// Points of the depth image that lie on the liver, spread evenly over what the camera sees of it.
//
//     liver pixel:  the liver's newest predicted surface covers it, and the depth measured there is within a gate of it
//     point:        plane through the inverse depths around it (lift.h): holes, edges, flying pixels and grazing views
//     give none
#pragma once

#include <vector>

#include "core/camera/z_buffer.h"
#include "core/case/surface.h"
#include "plugins/observation/lift.h"

namespace teres {

struct SurfaceSample {
    Eigen::Vector3d x = Eigen::Vector3d::Zero();  ///< depth camera's axes [m]
    double sigma_m = 0.0;                         ///< along the line of sight
};

class SurfaceSampler {
  public:
    explicit SurfaceSampler(const TetMeshData& mesh) : triangles_(Surface(mesh).triangles()) {}

    /// [loop] nodes: the liver as predicted, case axes; about `count` places are tried.
    std::vector<SurfaceSample> sample(std::span<const Point> nodes, const cv::Mat& counts, double depth_unit_m,
                                      const CameraModel& camera, const Pose& to_case, int count, double gate_m,
                                      const LiftOptions& options);

  private:
    std::vector<std::array<std::int32_t, 3>> triangles_;
    ZBuffer buffer_{1, 1};
    std::vector<ZBuffer::Vertex> vertices_;
};

}  // namespace teres
