#include "plugins/observation/surface_sampler.h"

#include <algorithm>
#include <cmath>

namespace teres {

std::vector<SurfaceSample> SurfaceSampler::sample(std::span<const Point> nodes, const cv::Mat& counts,
                                                  double depth_unit_m, const CameraModel& camera, const Pose& to_case,
                                                  int count, double gate_m, const LiftOptions& options) {
    if (buffer_.width() != camera.width_px || buffer_.height() != camera.height_px)
        buffer_ = ZBuffer(camera.width_px, camera.height_px);
    buffer_.clear();
    ZBuffer::project(nodes, to_case.inverse(), camera, vertices_);
    buffer_.draw(vertices_, triangles_);
    const auto covered =
        std::count_if(buffer_.ids().begin(), buffer_.ids().end(), [](std::int32_t id) { return id >= 0; });
    const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(covered) / std::max(1, count))));
    const DepthLift lift(counts, depth_unit_m, camera, camera, {}, options);
    std::vector<SurfaceSample> samples;
    for (int v = stride / 2; v < camera.height_px; v += stride)
        for (int u = stride / 2; u < camera.width_px; u += stride) {
            const double predicted = buffer_.z_m(u, v), measured = depth_unit_m * counts.at<std::uint16_t>(v, u);
            if (buffer_.id(u, v) < 0 || !(std::abs(measured - predicted) < gate_m)) continue;
            const auto point = lift.at({{double(u), double(v)}}, measured);
            if (point && std::abs(point->x.z() - predicted) < gate_m)
                samples.push_back({point->x, std::sqrt(point->covariance(2, 2))});
        }
    return samples;
}

}  // namespace teres
