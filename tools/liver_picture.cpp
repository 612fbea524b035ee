#include "tools/liver_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "core/case/geometry.h"
#include "core/case/surface.h"
#include "core/case/text_file.h"
#include "tools/canvas.h"

namespace teres::tools {
namespace {

// From the liver's red-brown over pale to blue: hue tells the value, so that shading cannot be taken for it.
Color value_color(double value) {
    static constexpr std::array<Color, 5> kStops{
        {{178, 104, 92}, {203, 152, 130}, {228, 220, 190}, {96, 178, 202}, {0, 92, 175}}};
    if (std::isnan(value)) return {150, 150, 150};
    const double at = std::clamp(value, 0.0, 1.0) * (kStops.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
    const double f = at - static_cast<double>(i);
    const Color a = kStops[i], b = kStops[i + 1];
    return {a.r + f * (b.r - a.r), a.g + f * (b.g - a.g), a.b + f * (b.b - a.b)};
}

Point unit(const Point& v) {
    return times(1.0 / norm(v), v);
}

// Right-handed axes of the picture: x to the right, y up, z towards the eye.
struct Camera {
    Point x, y, z;
    double scale = 1.0;    // drawn pixels per metre
    Point center{};        // [m], lands in the middle
    cv::Point2d middle{};  // drawn pixels
    Point project(const Point& p) const {
        const Point d = minus(p, center);
        return {middle.x + scale * dot(d, x), middle.y - scale * dot(d, y), scale * dot(d, z)};
    }
};

Result<Camera> make_camera(const View& view) {
    if (!(norm(view.from) > 0.0)) return invalid_input("view '" + view.name + "' has no direction");
    Camera camera;
    camera.z = unit(view.from);
    Point right = cross(view.up, camera.z);
    if (norm(right) < 1e-6 * (1.0 + norm(view.up))) {  // up along the view: any other up will do
        const Point other = std::abs(camera.z[1]) < 0.9 ? Point{0.0, 1.0, 0.0} : Point{0.0, 0.0, -1.0};
        right = cross(other, camera.z);
    }
    camera.x = unit(right);
    camera.y = cross(camera.z, camera.x);
    return camera;
}

// Z-buffer and colour of one view.
class Raster {
  public:
    Raster(int width, int height)
        : image(height, width, CV_8UC3, cv::Scalar(255, 255, 255)),
          depth_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                 -std::numeric_limits<double>::infinity()) {}

    cv::Mat image;

    struct Vertex {
        Point at;      // pixels, z towards the eye
        Point normal;  // in picture axes
        double value = 0.0;
    };

    void triangle(const Vertex& a, const Vertex& b, const Vertex& c) {
        const double area = (b.at[0] - a.at[0]) * (c.at[1] - a.at[1]) - (b.at[1] - a.at[1]) * (c.at[0] - a.at[0]);
        if (std::abs(area) < 1e-12) return;
        const auto low = [](double u, double v, double w) { return static_cast<int>(std::floor(std::min({u, v, w}))); };
        const auto high = [](double u, double v, double w) { return static_cast<int>(std::ceil(std::max({u, v, w}))); };
        const int x0 = std::max(low(a.at[0], b.at[0], c.at[0]), 0), y0 = std::max(low(a.at[1], b.at[1], c.at[1]), 0);
        const int x1 = std::min(high(a.at[0], b.at[0], c.at[0]), image.cols - 1);
        const int y1 = std::min(high(a.at[1], b.at[1], c.at[1]), image.rows - 1);
        for (int y = y0; y <= y1; ++y)
            for (int x = x0; x <= x1; ++x) {
                const double px = x + 0.5, py = y + 0.5;
                const double wb = ((px - a.at[0]) * (c.at[1] - a.at[1]) - (py - a.at[1]) * (c.at[0] - a.at[0])) / area;
                const double wc = ((b.at[0] - a.at[0]) * (py - a.at[1]) - (b.at[1] - a.at[1]) * (px - a.at[0])) / area;
                const double wa = 1.0 - wb - wc;
                if (wa < 0.0 || wb < 0.0 || wc < 0.0) continue;
                const double z = wa * a.at[2] + wb * b.at[2] + wc * c.at[2];
                double& depth = depth_[index(x, y)];
                if (z <= depth) continue;
                depth = z;
                const Point n = plus(plus(times(wa, a.normal), times(wb, b.normal)), times(wc, c.normal));
                image.at<cv::Vec3b>(y, x) = shade(value_color(wa * a.value + wb * b.value + wc * c.value), n);
            }
    }

    /// Is a point at depth z (within `margin`) in front of what is drawn at this pixel?
    bool visible(const Point& p, double margin) const {
        const int x = static_cast<int>(p[0]), y = static_cast<int>(p[1]);
        if (x < 0 || y < 0 || x >= image.cols || y >= image.rows) return false;
        return p[2] + margin >= depth_[index(x, y)];
    }

  private:
    std::size_t index(int x, int y) const {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.cols) + static_cast<std::size_t>(x);
    }

    // Lambert with a key light from the upper left in front and a weak fill, plus a small highlight.
    static cv::Vec3b shade(Color color, const Point& normal) {
        const double length = norm(normal);
        const Point n = length > 0.0 ? times(1.0 / length, normal) : Point{0.0, 0.0, 1.0};
        static const Point kKey = unit({-0.45, 0.55, 0.75}), kFill = unit({0.7, -0.3, 0.5});
        static const Point kHalf = unit(plus(kKey, {0.0, 0.0, 1.0}));
        const double light = 0.38 + 0.58 * std::max(0.0, dot(n, kKey)) + 0.14 * std::max(0.0, dot(n, kFill));
        const double highlight = 38.0 * std::pow(std::max(0.0, dot(n, kHalf)), 40.0);
        const auto channel = [&](double v) {
            return static_cast<uchar>(std::clamp(v * light + highlight, 0.0, 255.0));
        };
        return {channel(color.b), channel(color.g), channel(color.r)};
    }

    std::vector<double> depth_;
};

// Edges between a triangle whose nodes all belong to `nodes` and one with a node that does not.
std::vector<std::pair<std::int32_t, std::int32_t>> border(const Surface& surface,
                                                          const std::vector<std::int32_t>& nodes) {
    const std::vector<std::int32_t>& n = nodes;
    const auto inside = [&](std::int32_t id) { return std::binary_search(n.begin(), n.end(), id); };
    std::map<std::pair<std::int32_t, std::int32_t>, int> edges;  // how many inside triangles share it
    for (const auto& t : surface.triangles()) {
        if (!inside(t[0]) || !inside(t[1]) || !inside(t[2])) continue;
        for (std::size_t k = 0; k < 3; ++k) ++edges[std::minmax({t[k], t[(k + 1) % 3]})];
    }
    std::vector<std::pair<std::int32_t, std::int32_t>> out;
    for (const auto& [edge, count] : edges)
        if (count == 1) out.push_back(edge);
    return out;
}

// Draws a line on the surface where it is not hidden.
void surface_line(Canvas& canvas, const Raster& raster, cv::Point2d corner, const Point& a, const Point& b,
                  double margin, Color color, double thickness_px) {
    constexpr int kPieces = 8;
    for (int i = 0; i < kPieces; ++i) {
        const Point p = plus(a, times(static_cast<double>(i) / kPieces, minus(b, a)));
        const Point q = plus(a, times((i + 1.0) / kPieces, minus(b, a)));
        if (!raster.visible(times(0.5, plus(p, q)), margin)) continue;
        const double s = Canvas::kScale;
        canvas.line(corner + cv::Point2d(p[0] / s, p[1] / s), corner + cv::Point2d(q[0] / s, q[1] / s), color,
                    thickness_px);
    }
}

void draw_axes(Canvas& canvas, const Camera& camera, cv::Point2d origin) {
    constexpr double kLength_px = 30.0;
    const std::array<const char*, 3> names{"x", "y", "z"};
    for (std::size_t k = 0; k < 3; ++k) {
        Point e{};
        e[k] = 1.0;
        const cv::Point2d tip = origin + kLength_px * cv::Point2d(dot(e, camera.x), -dot(e, camera.y));
        canvas.line(origin, tip, kInk, 2.0);
        const cv::Point2d d = tip - origin;
        const double length = std::hypot(d.x, d.y);
        if (length < 8.0) continue;  // points at the eye
        canvas.text(tip + d * (12.0 / length), names[k], 11.0, Align::kCenter);
    }
}

// A length that fits about a quarter of the view, 1, 2 or 5 times a power of ten.
void draw_scale_bar(Canvas& canvas, double pixels_per_m, double room_px, cv::Point2d right_end) {
    const double wanted_mm = 1e3 * 0.3 * room_px / pixels_per_m;
    const double power = std::pow(10.0, std::floor(std::log10(wanted_mm)));
    double mm = power;
    for (const double factor : {2.0, 5.0})
        if (factor * power <= wanted_mm) mm = factor * power;
    const double length = 1e-3 * mm * pixels_per_m;
    const cv::Point2d left = right_end - cv::Point2d(length, 0.0);
    canvas.line(left, right_end, kInk, 2.5);
    for (const cv::Point2d& end : {left, right_end})
        canvas.line(end - cv::Point2d(0, 6), end + cv::Point2d(0, 6), kInk, 2.0);
    canvas.text(0.5 * (left + right_end) - cv::Point2d(0, 16), to_text(mm) + " mm", 12.0, Align::kCenter);
}

void draw_legend(Canvas& canvas, const LiverPicture& picture, double x, double y, double width) {
    constexpr int kSteps = 200;
    canvas.text({x, y - 20.0}, picture.value_name, 12.5);
    for (int i = 0; i < kSteps; ++i)
        canvas.rectangle({x + width * i / kSteps, y, width / kSteps + 0.6, 16.0}, value_color((i + 0.5) / kSteps));
    canvas.frame({x, y, width, 16.0}, kInk, 1.0);
    for (const double tick : {0.0, 0.25, 0.5, 0.75, 1.0}) {
        canvas.line({x + width * tick, y + 16.0}, {x + width * tick, y + 21.0}, kInk, 1.2);
        canvas.text({x + width * tick, y + 33.0}, to_text(tick), 11.0, Align::kCenter);
    }
    double next = x + width + 70.0;
    if (!picture.outline_nodes.empty()) {
        canvas.line({next, y + 8.0}, {next + 40.0, y + 8.0}, {255, 255, 255}, 6.0);
        canvas.line({next, y + 8.0}, {next + 40.0, y + 8.0}, {20, 20, 20}, 3.2);
        canvas.text({next + 52.0, y + 8.0}, picture.outline_name, 12.5);
        next += 52.0 + Canvas::text_width(picture.outline_name, 12.5) + 50.0;
    }
    if (!picture.dots.empty()) {
        canvas.dot({next + 8.0, y + 8.0}, 6.0, {20, 20, 20});
        canvas.dot({next + 8.0, y + 8.0}, 4.0, {255, 210, 60});
        canvas.text({next + 24.0, y + 8.0}, picture.dots_name, 12.5);
    }
}

}  // namespace

std::vector<View> default_views(const TetMeshData& mesh, const SensorData& sensor, const std::vector<double>& value) {
    View first{sensor.view_direction ? "camera" : "from +z", {0.0, 0.0, 1.0}, {0.0, 1.0, 0.0}};
    if (sensor.view_direction) first.from = times(-1.0, *sensor.view_direction);
    if (sensor.up) first.up = *sensor.up;
    const Surface surface(mesh);
    const std::vector<Point> normals = surface.node_normals();
    Point facing{};
    for (std::size_t i = 0; i < normals.size(); ++i) {
        const auto node = static_cast<std::size_t>(surface.nodes()[i]);
        if (node < value.size() && value[node] > 0.0) facing = plus(facing, times(value[node], normals[i]));
    }
    View second{"towards the attachment", facing, first.up};
    const double cosine = norm(facing) > 0.0 ? dot(unit(facing), unit(first.from)) : 1.0;
    if (cosine > std::cos(0.5)) {  // closer than 30 degrees, or no value at all: from above shows more
        second = {"from above", first.up, times(-1.0, first.from)};
    }
    return {first, second};
}

Status save_liver_picture(const LiverPicture& picture, const TetMeshData& mesh, const std::filesystem::path& file) {
    if (picture.value.size() != mesh.nodes.size())
        return invalid_input("picture '" + picture.title + "': " + std::to_string(picture.value.size()) +
                             " values for " + std::to_string(mesh.nodes.size()) + " nodes");
    std::vector<std::int32_t> outline = picture.outline_nodes;
    std::sort(outline.begin(), outline.end());
    const Surface surface(mesh);
    if (surface.triangles().empty()) return invalid_input("picture '" + picture.title + "': the mesh has no surface");
    const std::vector<Point> node_normals = surface.node_normals();
    std::vector<Point> normal(mesh.nodes.size());
    for (std::size_t i = 0; i < node_normals.size(); ++i)
        normal[static_cast<std::size_t>(surface.nodes()[i])] = node_normals[i];
    const auto border_edges = border(surface, outline);
    const std::vector<View> views = picture.views.empty() ? default_views(mesh, {}, picture.value) : picture.views;

    constexpr double kTop = 112.0, kBottom = 120.0;
    const int width = std::max(picture.width_px, 600), height = std::max(picture.height_px, 400);
    Canvas canvas(width, height);
    canvas.text({width / 2.0, 30.0}, picture.title, 18.0, Align::kCenter);
    const double view_width = width / static_cast<double>(views.size()), view_height = height - kTop - kBottom;
    const int raster_width = static_cast<int>(view_width * Canvas::kScale),
              raster_height = static_cast<int>(view_height * Canvas::kScale);

    std::vector<Camera> cameras;
    double scale = std::numeric_limits<double>::infinity();  // one for all views
    for (const View& view : views) {
        TERES_TRY_ASSIGN(Camera camera, make_camera(view));
        std::array<double, 3> low, high;
        low.fill(std::numeric_limits<double>::infinity());
        high.fill(-std::numeric_limits<double>::infinity());
        const std::array<Point, 3> axes{camera.x, camera.y, camera.z};
        for (const std::int32_t id : surface.nodes())
            for (std::size_t k = 0; k < 3; ++k) {
                const double at = dot(mesh.nodes[static_cast<std::size_t>(id)], axes[k]);
                low[k] = std::min(low[k], at);
                high[k] = std::max(high[k], at);
            }
        for (std::size_t k = 0; k < 3; ++k)
            camera.center = plus(camera.center, times(0.5 * (low[k] + high[k]), axes[k]));
        camera.middle = {raster_width / 2.0, raster_height / 2.0};
        scale = std::min({scale, 0.90 * raster_width / (high[0] - low[0]), 0.90 * raster_height / (high[1] - low[1])});
        cameras.push_back(camera);
    }
    for (std::size_t v = 0; v < views.size(); ++v) {
        Camera& camera = cameras[v];
        camera.scale = scale;
        Raster raster(raster_width, raster_height);
        const auto vertex = [&](std::int32_t id) {
            const auto node = static_cast<std::size_t>(id);
            const Point& n = normal[node];
            return Raster::Vertex{camera.project(mesh.nodes[node]),
                                  {dot(n, camera.x), dot(n, camera.y), dot(n, camera.z)},
                                  picture.value[node]};
        };
        for (const auto& [a, b, c] : surface.triangles()) raster.triangle(vertex(a), vertex(b), vertex(c));
        const cv::Point2d corner(view_width * static_cast<double>(v), kTop);
        canvas.paste(raster.image, corner);
        const double margin = 1.5e-3 * scale;  // 1.5 mm: lines lie on the surface, give or take its facets
        for (const auto& [color, thickness] : {std::pair{Color{255, 255, 255}, 6.0}, std::pair{Color{20, 20, 20}, 3.2}})
            for (const auto& [a, b] : border_edges)
                surface_line(canvas, raster, corner, camera.project(mesh.nodes[static_cast<std::size_t>(a)]),
                             camera.project(mesh.nodes[static_cast<std::size_t>(b)]), margin, color, thickness);
        for (const Point& dot_m : picture.dots) {
            const Point at = camera.project(dot_m);
            if (!raster.visible(at, 4e-3 * scale)) continue;
            const cv::Point2d center = corner + cv::Point2d(at[0], at[1]) / static_cast<double>(Canvas::kScale);
            canvas.dot(center, 6.0, {20, 20, 20});
            canvas.dot(center, 4.0, {255, 210, 60});
        }
        canvas.text({corner.x + view_width / 2.0, kTop - 34.0}, views[v].name, 14.0, Align::kCenter);
        draw_axes(canvas, camera, {corner.x + 70.0, kTop - 26.0});
    }
    const double pixels_per_m = scale / Canvas::kScale;
    draw_scale_bar(canvas, pixels_per_m, view_width, {width - 40.0, height - 52.0});
    draw_legend(canvas, picture, 60.0, height - 66.0, std::min(420.0, 0.3 * width));
    return canvas.save(file);
}

}  // namespace teres::tools
