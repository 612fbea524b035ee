#include "core/camera/z_buffer.h"

#include <algorithm>
#include <cmath>

namespace teres {
namespace {

constexpr float kOverlap = 1e-4F;  // in weights: rounding leaves no gap between neighbours

}  // namespace

ZBuffer::ZBuffer(int width_px, int height_px)
    : width_(width_px),
      height_(height_px),
      inverse_z_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px), 0.0F),
      id_(inverse_z_.size(), -1) {}

void ZBuffer::clear() {
    std::fill(inverse_z_.begin(), inverse_z_.end(), 0.0F);
    std::fill(id_.begin(), id_.end(), -1);
}

void ZBuffer::project(std::span<const Point> points, const Pose& to_camera, const CameraModel& camera,
                      std::vector<Vertex>& out) {
    out.resize(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Point x = to_camera.apply(points[i]);
        const auto pixel = camera.project(x);
        out[i] = pixel ? Vertex{static_cast<float>(pixel->u), static_cast<float>(pixel->v), static_cast<float>(x[2])}
                       : Vertex{};
    }
}

void ZBuffer::draw(std::span<const Vertex> vertices, std::span<const std::array<std::int32_t, 3>> triangles,
                   std::int32_t first_id, bool cull) {
    for (std::size_t t = 0; t < triangles.size(); ++t)
        draw_one(vertices[static_cast<std::size_t>(triangles[t][0])],
                 vertices[static_cast<std::size_t>(triangles[t][1])],
                 vertices[static_cast<std::size_t>(triangles[t][2])], first_id + static_cast<std::int32_t>(t), cull);
}

void ZBuffer::draw_one(const Vertex& a, const Vertex& b, const Vertex& c, std::int32_t id, bool cull) {
    if (!(a.z_m > 0.0F && b.z_m > 0.0F && c.z_m > 0.0F)) return;
    const float area = (b.u - a.u) * (c.v - a.v) - (c.u - a.u) * (b.v - a.v);
    if (!(std::abs(area) > 1e-6F) || (cull && area > 0.0F)) return;  // v points down: counter-clockwise is negative
    const float low_u = std::min({a.u, b.u, c.u}), high_u = std::max({a.u, b.u, c.u});
    const float low_v = std::min({a.v, b.v, c.v}), high_v = std::max({a.v, b.v, c.v});
    if (!(high_u >= 0.0F && high_v >= 0.0F && low_u <= static_cast<float>(width_ - 1) &&
          low_v <= static_cast<float>(height_ - 1)))
        return;
    const int u0 = std::max(0, static_cast<int>(std::ceil(low_u))),
              v0 = std::max(0, static_cast<int>(std::ceil(low_v)));
    const int u1 = static_cast<int>(std::min(std::floor(high_u), static_cast<float>(width_ - 1)));
    const int v1 = static_cast<int>(std::min(std::floor(high_v), static_cast<float>(height_ - 1)));
    // Weights w_b, w_c and 1/z as affine functions of the pixel.
    const float s = 1.0F / area;
    const float bu = s * (c.v - a.v), bv = -s * (c.u - a.u), cu = -s * (b.v - a.v), cv = s * (b.u - a.u);
    const float ia = 1.0F / a.z_m, ib = 1.0F / b.z_m - ia, ic = 1.0F / c.z_m - ia;
    for (int v = v0; v <= v1; ++v) {
        const float du = static_cast<float>(u0) - a.u, dv = static_cast<float>(v) - a.v;
        float wb = bu * du + bv * dv, wc = cu * du + cv * dv;
        std::size_t at = index(u0, v);
        for (int u = u0; u <= u1; ++u, ++at, wb += bu, wc += cu) {
            if (wb < -kOverlap || wc < -kOverlap || wb + wc > 1.0F + kOverlap) continue;
            const float inverse = ia + wb * ib + wc * ic;
            if (inverse <= inverse_z_[at]) continue;
            inverse_z_[at] = inverse;
            id_[at] = id;
        }
    }
}

std::array<double, 3> ZBuffer::weights(const Vertex& a, const Vertex& b, const Vertex& c, double u, double v) {
    const double area = double(b.u - a.u) * (c.v - a.v) - double(c.u - a.u) * (b.v - a.v);
    const double wb = ((u - a.u) * (c.v - a.v) - (c.u - a.u) * (v - a.v)) / area;
    const double wc = ((b.u - a.u) * (v - a.v) - (u - a.u) * (b.v - a.v)) / area;
    const double pa = (1.0 - wb - wc) / a.z_m, pb = wb / b.z_m, pc = wc / c.z_m, sum = pa + pb + pc;
    return {pa / sum, pb / sum, pc / sum};
}

}  // namespace teres
