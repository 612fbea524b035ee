#include "core/camera/camera_model.h"

#include <algorithm>
#include <cmath>

#include "core/case/geometry.h"

namespace teres {
namespace {

constexpr int kUndistortIterations = 20;

struct Distorted {
    double x, y;
};

Distorted distort(const std::array<double, 5>& d, double x, double y) {
    const double r2 = x * x + y * y;
    const double g = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
    return {g * x + 2.0 * d[2] * x * y + d[3] * (r2 + 2.0 * x * x),
            g * y + d[2] * (r2 + 2.0 * y * y) + 2.0 * d[3] * x * y};
}

Status check(bool holds, const std::string& place, const std::string& what) {
    if (holds) return {};
    return invalid_input("camera_info of " + place + ": " + what);
}

}  // namespace

Point Pose::rotate(const Point& x) const {
    return {R[0] * x[0] + R[1] * x[1] + R[2] * x[2], R[3] * x[0] + R[4] * x[1] + R[5] * x[2],
            R[6] * x[0] + R[7] * x[1] + R[8] * x[2]};
}

Point Pose::apply(const Point& x) const {
    return plus(rotate(x), t);
}

Pose Pose::inverse() const {
    Pose inverse;
    inverse.R = {R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]};
    inverse.t = times(-1.0, inverse.rotate(t));
    return inverse;
}

Pose Pose::operator*(const Pose& first) const {
    Pose both;
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            both.R[3 * i + j] = 0.0;
            for (std::size_t k = 0; k < 3; ++k) both.R[3 * i + j] += R[3 * i + k] * first.R[3 * k + j];
        }
    both.t = apply(first.t);
    return both;
}

std::optional<Pose> camera_pose(const SensorData& sensor) {
    if (!sensor.camera_position_m || !sensor.view_direction || !sensor.up) return std::nullopt;
    const Point& view = *sensor.view_direction;
    const Point right = cross(view, *sensor.up);
    const double view_length = norm(view), right_length = norm(right);
    if (!(view_length > 0.0) || !(right_length > 1e-6 * view_length)) return std::nullopt;
    const Point z = times(1.0 / view_length, view), x = times(1.0 / right_length, right), y = cross(z, x);
    Pose pose;
    pose.R = {x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]};
    pose.t = *sensor.camera_position_m;
    return pose;
}

std::optional<Pixel> CameraModel::project(const Point& p) const {
    if (!(p[2] > 1e-6)) return std::nullopt;
    const double x = p[0] / p[2], y = p[1] / p[2], r2 = x * x + y * y;
    // Beyond the first turning point of r g(r) the model folds back: such points are not seen there.
    if (1.0 + r2 * (3.0 * distortion[0] + r2 * (5.0 * distortion[1] + 7.0 * r2 * distortion[4])) <= 0.0)
        return std::nullopt;
    const Distorted d = distort(distortion, x, y);
    return Pixel{fx_px * d.x + cx_px, fy_px * d.y + cy_px};
}

Point CameraModel::ray(const Pixel& pixel) const {
    const double xd = (pixel.u - cx_px) / fx_px, yd = (pixel.v - cy_px) / fy_px;
    double x = xd, y = yd;
    for (int i = 0; i < kUndistortIterations; ++i) {  // fixed point: x <- x - (distort(x) - x_d)
        const Distorted d = distort(distortion, x, y);
        x -= d.x - xd;
        y -= d.y - yd;
        if (std::abs(d.x - xd) + std::abs(d.y - yd) < 1e-12) break;
    }
    return {x, y, 1.0};
}

Result<StreamInfo> stream_info(const camera_info_t& m) {
    const std::string place = (m.header.frame_id.empty() ? "(no frame)" : m.header.frame_id) + " " + m.serial;
    TERES_TRY(
        check(m.width_px > 0 && m.height_px > 0 && m.width_px <= 16384 && m.height_px <= 16384, place,
              "size " + std::to_string(m.width_px) + "x" + std::to_string(m.height_px) + " px is not within 1..16384"));
    bool finite = true;
    for (const double v : {m.fx_px, m.fy_px, m.cx_px, m.cy_px, m.depth_unit_m, m.baseline_m})
        finite = finite && std::isfinite(v);
    for (const double v : m.distortion) finite = finite && std::isfinite(v);
    for (const double v : m.rotation) finite = finite && std::isfinite(v);
    for (const double v : m.translation_m) finite = finite && std::isfinite(v);
    TERES_TRY(check(finite, place, "a value is not finite"));
    TERES_TRY(check(m.fx_px > 0.0 && m.fy_px > 0.0, place,
                    "fx, fy = " + std::to_string(m.fx_px) + ", " + std::to_string(m.fy_px) + " px, must be positive"));
    TERES_TRY(check(m.depth_unit_m >= 0.0, place, "depth_unit_m is negative"));
    StreamInfo info;
    info.serial = m.serial;
    info.frame_id = m.header.frame_id;
    info.reference_frame = m.reference_frame;
    info.camera = {m.width_px, m.height_px, m.fx_px, m.fy_px, m.cx_px, m.cy_px, {}};
    std::copy(std::begin(m.distortion), std::end(m.distortion), info.camera.distortion.begin());
    std::copy(std::begin(m.rotation), std::end(m.rotation), info.to_reference.R.begin());
    std::copy(std::begin(m.translation_m), std::end(m.translation_m), info.to_reference.t.begin());
    const Pose unit = info.to_reference * Pose{info.to_reference.inverse().R, {}};
    const Pose identity;
    for (std::size_t i = 0; i < 9; ++i)
        TERES_TRY(check(std::abs(unit.R[i] - identity.R[i]) < 1e-6, place, "rotation is no rotation matrix"));
    info.depth_unit_m = m.depth_unit_m;
    info.baseline_m = m.baseline_m;
    return info;
}

camera_info_t to_message(const StreamInfo& info) {
    camera_info_t m{};
    m.serial = info.serial;
    m.header.frame_id = info.frame_id;
    m.reference_frame = info.reference_frame;
    m.width_px = info.camera.width_px;
    m.height_px = info.camera.height_px;
    m.fx_px = info.camera.fx_px;
    m.fy_px = info.camera.fy_px;
    m.cx_px = info.camera.cx_px;
    m.cy_px = info.camera.cy_px;
    m.depth_unit_m = info.depth_unit_m;
    m.baseline_m = info.baseline_m;
    std::copy(info.camera.distortion.begin(), info.camera.distortion.end(), std::begin(m.distortion));
    std::copy(info.to_reference.R.begin(), info.to_reference.R.end(), std::begin(m.rotation));
    std::copy(info.to_reference.t.begin(), info.to_reference.t.end(), std::begin(m.translation_m));
    return m;
}

}  // namespace teres
