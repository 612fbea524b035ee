#include "tools/phantom/renderer.h"

#include <algorithm>
#include <cmath>

#include "core/case/geometry.h"

namespace teres::phantom {
namespace {

constexpr int kShadowSize = 768;

std::size_t at(std::int32_t index) {
    return static_cast<std::size_t>(index);
}

// Lattice value in [0, 1] from a bit mixer; smooth in between.
double lattice(int x, int y, int z) {
    auto h = static_cast<std::uint32_t>(x) * 0x8da6b343U ^ static_cast<std::uint32_t>(y) * 0xd8163841U ^
             static_cast<std::uint32_t>(z) * 0xcb1ab31fU;
    h = (h ^ (h >> 15)) * 0x2c1b3c6dU;
    return static_cast<double>((h ^ (h >> 12)) & 0xffffU) / 65535.0;
}

double noise(const Point& p, double per_m) {
    std::array<int, 3> i{};
    Point f{};
    for (std::size_t a = 0; a < 3; ++a) {
        const double x = p[a] * per_m, low = std::floor(x);
        i[a] = static_cast<int>(low);
        f[a] = (x - low) * (x - low) * (3.0 - 2.0 * (x - low));
    }
    double value = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
        value += (dx ? f[0] : 1.0 - f[0]) * (dy ? f[1] : 1.0 - f[1]) * (dz ? f[2] : 1.0 - f[2]) *
                 lattice(i[0] + dx, i[1] + dy, i[2] + dz);
    }
    return value;
}

Point unit(const Point& x) {
    const double length = norm(x);
    return length > 0.0 ? times(1.0 / length, x) : x;
}

}  // namespace

Renderer::Renderer(const Scene& scene, const Look& look, std::uint64_t seed)
    : scene_(scene), look_(look), random_(seed), buffer_(1, 1), shadow_(kShadowSize, kShadowSize) {
    const Mesh& mesh = scene.mesh();
    markers_near_.resize(mesh.triangles.size());
    const double reach = 1.5 * scene.options().marker_radius_m;
    for (std::size_t t = 0; t < mesh.triangles.size() && !look_.no_markers; ++t) {
        if (mesh.material[t] != Material::kLiver) continue;
        const auto& [a, b, c] = mesh.triangles[t];
        const Point middle = times(1.0 / 3.0, plus(plus(mesh.rest[at(a)], mesh.rest[at(b)]), mesh.rest[at(c)]));
        double radius = 0.0;
        for (const std::int32_t n : mesh.triangles[t]) radius = std::max(radius, distance(middle, mesh.rest[at(n)]));
        for (std::size_t m = 0; m < scene.markers().size(); ++m)
            if (distance(middle, scene.markers()[m].rest) < radius + reach)
                markers_near_[t].push_back(static_cast<std::int32_t>(m));
    }
    // The lamp hangs beside the camera and looks where it looks.
    Pose lamp = scene.camera();
    lamp_ = lamp.t = lamp.apply({-0.10, -0.12, -0.05});
    to_lamp_ = lamp.inverse();
    lamp_camera_ = {kShadowSize,        kShadowSize, 0.9 * kShadowSize, 0.9 * kShadowSize, 0.30 * kShadowSize,
                    0.30 * kShadowSize, {}};
}

void Renderer::begin_frame() {
    const Mesh& mesh = scene_.mesh();
    normals_.assign(mesh.now.size(), Point{});
    for (const auto& [a, b, c] : mesh.triangles) {
        const Point n = cross(minus(mesh.now[at(b)], mesh.now[at(a)]), minus(mesh.now[at(c)], mesh.now[at(a)]));
        for (const std::int32_t v : {a, b, c}) normals_[at(v)] = plus(normals_[at(v)], n);
    }
    shadow_.clear();
    ZBuffer::project(mesh.now, to_lamp_, lamp_camera_, lamp_vertices_);
    shadow_.draw(lamp_vertices_, mesh.triangles);
}

void Renderer::raster(const CameraModel& camera, const Pose& camera_pose) {
    if (buffer_.width() != camera.width_px || buffer_.height() != camera.height_px)
        buffer_ = ZBuffer(camera.width_px, camera.height_px);
    buffer_.clear();
    camera_ = camera;
    to_camera_ = camera_pose.inverse();
    ZBuffer::project(scene_.mesh().now, to_camera_, camera, vertices_);
    buffer_.draw(vertices_, scene_.mesh().triangles);
}

Renderer::Surfel Renderer::surfel(int u, int v) const {
    const Mesh& mesh = scene_.mesh();
    const std::int32_t id = buffer_.id(u, v);
    const auto& corners = mesh.triangles[at(id)];
    const auto w =
        ZBuffer::weights(vertices_[at(corners[0])], vertices_[at(corners[1])], vertices_[at(corners[2])], u, v);
    Surfel s{mesh.material[at(id)], {}, {}, {}, id};
    for (std::size_t i = 0; i < 3; ++i) {
        s.rest = plus(s.rest, times(w[i], mesh.rest[at(corners[i])]));
        s.now = plus(s.now, times(w[i], mesh.now[at(corners[i])]));
        s.normal = plus(s.normal, times(w[i], unit(normals_[at(corners[i])])));
    }
    if (s.material != Material::kLiver)  // flat faces, sharp edges
        s.normal = cross(minus(mesh.now[at(corners[1])], mesh.now[at(corners[0])]),
                         minus(mesh.now[at(corners[2])], mesh.now[at(corners[0])]));
    s.normal = unit(s.normal);
    return s;
}

// Reflectance, blue-green-red.
cv::Vec3d Renderer::albedo(const Surfel& s) const {
    switch (s.material) {
        case Material::kLiver: {
            cv::Vec3d tone = cv::Vec3d(0.30, 0.36, 0.62) *
                             (0.80 + look_.texture * (0.14 * noise(s.rest, 140.0) + 0.12 * noise(s.rest, 600.0)));
            for (const std::int32_t m : markers_near_[at(s.triangle)]) {
                // Edge one pixel wide: no staircase that would pull the centroid.
                const double d = distance(s.rest, scene_.markers()[at(m)].rest);
                const double inside = std::clamp((scene_.options().marker_radius_m - d) / 0.0005 + 0.5, 0.0, 1.0);
                const double paint = look_.bright_markers ? 1.0 : 0.04;
                tone = (1.0 - inside) * tone + inside * cv::Vec3d(paint, paint, paint);
            }
            return tone;
        }
        case Material::kCloth: {
            const double weave = 0.5 + 0.5 * std::sin(2500.0 * s.rest[0]) * std::sin(2500.0 * s.rest[2]);
            return cv::Vec3d(0.72, 0.78, 0.80) * (0.85 + 0.15 * weave);
        }
        case Material::kWood: {
            const double ring = 0.5 + 0.5 * std::sin(420.0 * (s.rest[0] + 0.2 * s.rest[1]) + 9.0 * noise(s.rest, 30.0));
            return cv::Vec3d(0.28, 0.48, 0.66) * (0.75 + 0.25 * ring);
        }
        case Material::kTable:
            return cv::Vec3d(0.42, 0.40, 0.30) * (0.85 + 0.3 * noise(s.rest, 90.0));
        case Material::kSteel:
            return cv::Vec3d(0.66, 0.64, 0.62) * (0.9 + 0.1 * noise(s.rest, 300.0));
    }
    return {};
}

double Renderer::lit(const Surfel& s) const {
    const Point to_lamp = unit(minus(lamp_, s.now)), to_eye = unit(minus(scene_.camera().t, s.now));
    Point n = s.normal;
    if (dot(n, to_eye) < 0.0) n = times(-1.0, n);
    const Point x = to_lamp_.apply(s.now);
    double shade = 1.0;
    if (const auto p = lamp_camera_.project(x); p && lamp_camera_.contains(*p)) {
        const float z = shadow_.z_m(static_cast<int>(std::lround(p->u)), static_cast<int>(std::lround(p->v)));
        if (z > 0.0F && x[2] > z + 0.006) shade = 0.25;
    }
    const double diffuse = std::max(0.0, dot(n, to_lamp));
    const Point half = unit(plus(to_lamp, to_eye));
    const bool shiny = s.material == Material::kLiver || s.material == Material::kSteel;
    const double gloss = shiny ? 0.25 * std::pow(std::max(0.0, dot(n, half)), 60.0) : 0.0;
    return 0.30 + shade * (0.85 * diffuse + gloss);
}

cv::Mat Renderer::color(const CameraModel& camera, const Pose& camera_pose) {
    raster(camera, camera_pose);
    cv::Mat image(camera.height_px, camera.width_px, CV_8UC3), grain(image.size(), CV_16SC3);
    random_.fill(grain, cv::RNG::NORMAL, 0.0, look_.pixel_noise);
    for (int v = 0; v < image.rows; ++v)
        for (int u = 0; u < image.cols; ++u) {
            cv::Vec3d tone(8.0, 8.0, 8.0);
            if (buffer_.id(u, v) >= 0) {
                const Surfel s = surfel(u, v);
                tone = 255.0 * lit(s) * albedo(s);
            }
            for (int c = 0; c < 3; ++c)
                image.at<cv::Vec3b>(v, u)[c] = cv::saturate_cast<std::uint8_t>(tone[c] + grain.at<cv::Vec3s>(v, u)[c]);
        }
    return image;
}

cv::Mat Renderer::range(const CameraModel& camera, const Pose& camera_pose) {
    raster(camera, camera_pose);
    cv::Mat z(camera.height_px, camera.width_px, CV_32F);
    for (int v = 0; v < z.rows; ++v)
        for (int u = 0; u < z.cols; ++u) z.at<float>(v, u) = buffer_.z_m(u, v);
    return z;
}

bool Renderer::sees(const Point& x) const {
    const Point in_camera = to_camera_.apply(x);
    const auto p = camera_.project(in_camera);
    if (!p || !camera_.contains(*p, 2.0)) return false;
    const float z = buffer_.z_m(static_cast<int>(std::lround(p->u)), static_cast<int>(std::lround(p->v)));
    return z > 0.0F && in_camera[2] < z + 0.004;
}

}  // namespace teres::phantom
