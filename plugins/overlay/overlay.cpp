#include "plugins/overlay/overlay.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "core/case/csv_table.h"
#include "core/case/geometry.h"
#include "core/case/surface.h"

namespace teres {
namespace {

constexpr int kFixed = 4;  // fractional bits of drawn coordinates

std::size_t at(std::int32_t index) {
    return static_cast<std::size_t>(index);
}

cv::Point fixed(double u, double v) {
    return {static_cast<int>(std::lround(u * (1 << kFixed))), static_cast<int>(std::lround(v * (1 << kFixed)))};
}

}  // namespace

Result<std::vector<StructurePoint>> read_structures(const std::filesystem::path& file) {
    const std::vector<CsvColumn> columns{{"structure", CsvKind::kText}, {"x_m"}, {"y_m"}, {"z_m"}, {"radius_m"}};
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, columns));
    std::vector<StructurePoint> points;
    for (std::size_t row = 0; row < table.num_rows(); ++row)
        points.push_back({std::string(table.text(row, 0)),
                          {table.number(row, 1), table.number(row, 2), table.number(row, 3)},
                          table.number(row, 4)});
    return points;
}

Overlay::Overlay(const TetMeshData& mesh, std::vector<StructurePoint> structures, const OverlayOptions& options)
    : options_(options),
      triangles_(Surface(mesh).triangles()),
      structures_(std::move(structures)),
      probability_(mesh.nodes.size(), 0.0),
      nodes_(mesh.nodes),
      tints_(triangles_.size()) {
    embed(mesh);
}

// The tetrahedron that holds a point, else the one it is least outside of.
void Overlay::embed(const TetMeshData& mesh) {
    for (const StructurePoint& s : structures_) {
        Carrier best;
        double inside = -std::numeric_limits<double>::infinity();
        for (std::size_t t = 0; t < mesh.tets.size() && inside < 0.0; ++t) {
            const auto& n = mesh.tets[t];
            const double volume = signed_volume_m3(mesh, t);
            std::array<double, 4> w{};
            for (std::size_t i = 0; i < 4; ++i) {
                std::array<Point, 4> corner;
                for (std::size_t j = 0; j < 4; ++j) corner[j] = j == i ? s.rest_m : mesh.nodes[at(n[j])];
                w[i] =
                    dot(cross(minus(corner[1], corner[0]), minus(corner[2], corner[0])), minus(corner[3], corner[0])) /
                    (6.0 * volume);
            }
            const double lowest = *std::min_element(w.begin(), w.end());
            if (lowest <= inside) continue;
            inside = lowest;
            best = {n, w};
        }
        carriers_.push_back(best);
    }
}

void Overlay::set_camera(const CameraModel& camera, const Pose& camera_to_case) {
    camera_ = camera;
    to_camera_ = camera_to_case.inverse();
    buffer_ = ZBuffer(camera.width_px, camera.height_px);
}

void Overlay::set_attachment(std::span<const std::int32_t> nodes, std::span<const double> probability) {
    for (std::size_t i = 0; i < std::min(nodes.size(), probability.size()); ++i)
        if (nodes[i] >= 0 && at(nodes[i]) < probability_.size()) probability_[at(nodes[i])] = probability[i];
}

void Overlay::set_positions(std::span<const Point> nodes) {
    if (nodes.size() == nodes_.size()) std::copy(nodes.begin(), nodes.end(), nodes_.begin());
}

void Overlay::draw(cv::Mat& frame, bool stale) {
    if (frame.type() != CV_8UC3 || frame.cols != buffer_.width() || frame.rows != buffer_.height()) return;
    buffer_.clear();
    ZBuffer::project(nodes_, to_camera_, camera_, vertices_);
    buffer_.draw(vertices_, triangles_, 0, true);
    const Point eye = to_camera_.inverse().t;
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
        const auto& [a, b, c] = triangles_[t];
        const Point& x = nodes_[at(a)];
        const Point n = cross(minus(nodes_[at(b)], x), minus(nodes_[at(c)], x)), view = minus(eye, x);
        const double facing = std::max(0.0, dot(n, view) / std::max(1e-12, norm(n) * norm(view)));
        const double p = (probability_[at(a)] + probability_[at(b)] + probability_[at(c)]) / 3.0;
        // Blue-green veil; the ligament from yellow (may hold) to red (holds). Stale: grey.
        const double alpha =
            options_.liver_opacity + std::clamp(p, 0.0, 1.0) * (options_.ligament_opacity - options_.liver_opacity);
        const double shade = 0.55 + 0.45 * facing, w = std::min(1.0, 4.0 * p);
        double blue = (1.0 - w) * 200.0 + w * 30.0, green = (1.0 - w) * 190.0 + w * 230.0 * (1.0 - p),
               red = (1.0 - w) * 90.0 + w * 245.0;
        if (stale) blue = green = red = (blue + green + red) / 3.0;
        const double scale = 256.0 * alpha * shade;
        tints_[t] = {static_cast<int>(scale * blue), static_cast<int>(scale * green), static_cast<int>(scale * red),
                     static_cast<int>(256.0 * alpha)};
    }
    veil(frame, stale);
    draw_structures(frame, stale);
    draw_markers(frame);
    if (!stale) return;
    cv::rectangle(frame, {2, 2, frame.cols - 4, frame.rows - 4}, {40, 40, 230}, 4);
    cv::putText(frame, "STALE", {16, 40}, cv::FONT_HERSHEY_SIMPLEX, 1.1, {40, 40, 230}, 3, cv::LINE_AA);
}

void Overlay::veil(cv::Mat& frame, bool stale) const {
    const cv::Vec3b outline = stale ? cv::Vec3b(150, 150, 150) : cv::Vec3b(230, 220, 120);
    const std::int32_t* ids = buffer_.ids().data();
    for (int v = 0; v < frame.rows; ++v) {
        auto* row = frame.ptr<std::uint8_t>(v);
        const std::int32_t* here = ids + static_cast<std::ptrdiff_t>(v) * frame.cols;
        const std::int32_t* above = v > 0 ? here - frame.cols : here;
        for (int u = 0; u < frame.cols; ++u, row += 3) {
            const bool inside = here[u] >= 0;
            if (inside != (above[u] >= 0) || (u > 0 && inside != (here[u - 1] >= 0))) {
                for (int c = 0; c < 3; ++c) row[c] = outline[c];
                continue;
            }
            if (!inside) continue;
            const Tint& tint = tints_[at(here[u])];
            const int keep = 256 - tint.alpha;
            row[0] = static_cast<std::uint8_t>((keep * row[0] + tint.b) >> 8);
            row[1] = static_cast<std::uint8_t>((keep * row[1] + tint.g) >> 8);
            row[2] = static_cast<std::uint8_t>((keep * row[2] + tint.r) >> 8);
        }
    }
}

// Far ones first. Each is drawn on its own patch, then mixed in by its depth below the surface.
void Overlay::draw_structures(cv::Mat& frame, bool stale) const {
    std::vector<Point> x(structures_.size());
    for (std::size_t i = 0; i < structures_.size(); ++i) {
        Point position{};
        for (std::size_t k = 0; k < 4; ++k)
            position = plus(position, times(carriers_[i].weights[k], nodes_[at(carriers_[i].nodes[k])]));
        x[i] = to_camera_.apply(position);
    }
    std::vector<std::size_t> order(x.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return x[a][2] > x[b][2]; });
    for (const std::size_t i : order) {
        const auto p = camera_.project(x[i]);
        if (!p || !camera_.contains(*p)) continue;
        const double radius = structures_[i].radius_m * camera_.fx_px / x[i][2];
        std::optional<Pixel> joined;
        if (i > 0 && structures_[i - 1].name == structures_[i].name) joined = camera_.project(x[i - 1]);
        const int reach = static_cast<int>(std::ceil(radius)) + 2;
        cv::Rect box(static_cast<int>(p->u) - reach, static_cast<int>(p->v) - reach, 2 * reach + 1, 2 * reach + 1);
        if (joined)
            box |= cv::Rect(static_cast<int>(joined->u) - reach, static_cast<int>(joined->v) - reach, 2 * reach + 1,
                            2 * reach + 1);
        box &= cv::Rect(0, 0, frame.cols, frame.rows);
        if (box.area() == 0) continue;
        const float surface = buffer_.z_m(static_cast<int>(p->u), static_cast<int>(p->v));
        const double depth = surface > 0.0F ? std::max(0.0, x[i][2] - surface) : 0.0;
        const double alpha = options_.inner_opacity * std::exp(-depth / options_.fade_m);
        cv::Mat patch = frame(box).clone();
        const cv::Scalar color = stale ? cv::Scalar(140, 140, 140) : cv::Scalar(235, 120, 60);
        const cv::Point2d corner(box.x, box.y);
        if (joined)
            cv::line(patch, fixed(joined->u - corner.x, joined->v - corner.y), fixed(p->u - corner.x, p->v - corner.y),
                     color, std::max(1, static_cast<int>(std::lround(1.4 * radius))), cv::LINE_AA, kFixed);
        cv::circle(patch, fixed(p->u - corner.x, p->v - corner.y), static_cast<int>(radius * (1 << kFixed)), color,
                   cv::FILLED, cv::LINE_AA, kFixed);
        cv::circle(patch, fixed(p->u - 0.3 * radius - corner.x, p->v - 0.3 * radius - corner.y),
                   static_cast<int>(0.35 * radius * (1 << kFixed)), color + cv::Scalar(40, 80, 80), cv::FILLED,
                   cv::LINE_AA, kFixed);
        cv::addWeighted(patch, alpha, frame(box), 1.0 - alpha, 0.0, frame(box));
    }
}

void Overlay::draw_markers(cv::Mat& frame) const {
    for (const Point& marker : markers_) {
        if (!is_finite(marker)) continue;
        if (const auto p = camera_.project(to_camera_.apply(marker)); p && camera_.contains(*p))
            cv::circle(frame, fixed(p->u, p->v), 9 << kFixed, {80, 255, 120}, 1, cv::LINE_AA, kFixed);
    }
}

}  // namespace teres
