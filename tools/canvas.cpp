#include "tools/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace teres::tools {
namespace {

constexpr int kShift = 4;  // fractional bits of OpenCV's drawing coordinates
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kFontHeight_px = 21.0;  // capitals at scale 1

cv::Scalar bgr(Color c) {
    return {c.b, c.g, c.r};
}

cv::Point fixed(cv::Point2d p) {
    const double s = Canvas::kScale * (1 << kShift);
    // far-off points would overflow OpenCV's fixed point numbers
    const auto clamped = [&](double v) { return static_cast<int>(std::lround(std::clamp(v, -2e4, 4e4) * s)); };
    return {clamped(p.x), clamped(p.y)};
}

int thick(double px) {
    return std::max(1, static_cast<int>(std::lround(px * Canvas::kScale)));
}

std::string ascii(const std::string& text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto c = static_cast<unsigned char>(text[i]);
        if (c < 0x80)
            out += c >= ' ' ? text[i] : ' ';
        else if (c >= 0xC0)
            out += '?';  // one for the lead byte of a UTF-8 sequence
    }
    return out;
}

double font_scale(double height_px) {
    return height_px * Canvas::kScale / kFontHeight_px;
}
int font_thickness(double height_px) {
    return std::max(1, static_cast<int>(std::lround(height_px * Canvas::kScale / 11.0)));
}

}  // namespace

Color palette(std::size_t index) {
    static constexpr std::array<Color, 7> kColors{
        {{0, 114, 178}, {213, 94, 0}, {0, 158, 115}, {204, 121, 167}, {230, 159, 0}, {86, 180, 233}, {90, 90, 90}}};
    return kColors[index % kColors.size()];
}

Color sequential(double value) {
    static constexpr std::array<Color, 6> kStops{
        {{250, 244, 214}, {199, 228, 180}, {115, 198, 186}, {48, 147, 186}, {33, 86, 158}, {12, 33, 92}}};
    if (std::isnan(value)) return kPale;
    const double at = std::clamp(value, 0.0, 1.0) * (kStops.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
    const double f = at - static_cast<double>(i);
    const Color a = kStops[i], b = kStops[i + 1];
    return {a.r + f * (b.r - a.r), a.g + f * (b.g - a.g), a.b + f * (b.b - a.b)};
}

Canvas::Canvas(int width_px, int height_px)
    : width_(width_px), height_(height_px), pixels_(height_px * kScale, width_px * kScale, CV_8UC3, bgr(kPaper)) {}

void Canvas::line(cv::Point2d a, cv::Point2d b, Color color, double thickness_px) {
    cv::line(pixels_, fixed(a), fixed(b), bgr(color), thick(thickness_px), cv::LINE_AA, kShift);
}

void Canvas::polyline(std::span<const cv::Point2d> points, Color color, double thickness_px, bool dashed) {
    constexpr double kDash_px = 9.0;
    double along = 0.0;
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
        if (!dashed) {
            line(points[i], points[i + 1], color, thickness_px);
            continue;
        }
        const cv::Point2d step = points[i + 1] - points[i];
        const double length = std::min(std::hypot(step.x, step.y), 1e5);
        for (double s = 0.0; s < length;) {
            const double phase = std::fmod(along + s, 2.0 * kDash_px);
            const bool on = phase < kDash_px;
            const double to = std::min(length, s + (on ? kDash_px : 2.0 * kDash_px) - phase + 1e-6);
            if (on) line(points[i] + step * (s / length), points[i] + step * (to / length), color, thickness_px);
            s = to;
        }
        along += length;
    }
}

void Canvas::polygon(std::span<const cv::Point2d> points, Color color, double opacity) {
    if (points.size() < 3) return;
    std::vector<cv::Point> outline;
    outline.reserve(points.size());
    for (const cv::Point2d& p : points) outline.push_back(fixed(p));
    if (opacity >= 1.0) {
        cv::fillPoly(pixels_, std::vector<std::vector<cv::Point>>{outline}, bgr(color), cv::LINE_AA, kShift);
        return;
    }
    cv::Mat above = pixels_.clone();
    cv::fillPoly(above, std::vector<std::vector<cv::Point>>{outline}, bgr(color), cv::LINE_AA, kShift);
    cv::addWeighted(above, opacity, pixels_, 1.0 - opacity, 0.0, pixels_);
}

void Canvas::rectangle(cv::Rect2d box, Color color, double opacity) {
    const std::array<cv::Point2d, 4> corners{{{box.x, box.y},
                                              {box.x + box.width, box.y},
                                              {box.x + box.width, box.y + box.height},
                                              {box.x, box.y + box.height}}};
    polygon(corners, color, opacity);
}

void Canvas::frame(cv::Rect2d box, Color color, double thickness_px) {
    cv::rectangle(pixels_, fixed({box.x, box.y}), fixed({box.x + box.width, box.y + box.height}), bgr(color),
                  thick(thickness_px), cv::LINE_AA, kShift);
}

void Canvas::dot(cv::Point2d center, double radius_px, Color color) {
    cv::circle(pixels_, fixed(center), static_cast<int>(radius_px * kScale * (1 << kShift)), bgr(color), cv::FILLED,
               cv::LINE_AA, kShift);
}

double Canvas::text_width(const std::string& text, double height_px) {
    int baseline = 0;
    return static_cast<double>(
               cv::getTextSize(ascii(text), kFont, font_scale(height_px), font_thickness(height_px), &baseline).width) /
           kScale;
}

void Canvas::text(cv::Point2d at, const std::string& text, double height_px, Align align, Color color) {
    const double width = text_width(text, height_px);
    const double left = at.x - (align == Align::kLeft ? 0.0 : align == Align::kCenter ? width / 2.0 : width);
    const cv::Point origin(static_cast<int>(std::lround(left * kScale)),
                           static_cast<int>(std::lround((at.y + height_px / 2.0) * kScale)));
    cv::putText(pixels_, ascii(text), origin, kFont, font_scale(height_px), bgr(color), font_thickness(height_px),
                cv::LINE_AA);
}

void Canvas::vertical_text(cv::Point2d at, const std::string& text, double height_px, Color color) {
    const int margin = static_cast<int>(height_px * kScale);
    const int w = static_cast<int>(std::ceil(text_width(text, height_px) * kScale)) + 2 * margin;
    const int h = 3 * margin;
    // ink as a mask, so that the turned text keeps what is below it
    cv::Mat mask(h, w, CV_8UC1, cv::Scalar(0));
    cv::putText(mask, ascii(text), {margin, h / 2 + margin / 2}, kFont, font_scale(height_px), cv::Scalar(255),
                font_thickness(height_px), cv::LINE_AA);
    cv::rotate(mask, mask, cv::ROTATE_90_COUNTERCLOCKWISE);
    const cv::Rect place(static_cast<int>(at.x * kScale) - mask.cols / 2,
                         static_cast<int>(at.y * kScale) - mask.rows / 2, mask.cols, mask.rows);
    const cv::Rect inside = place & cv::Rect(0, 0, pixels_.cols, pixels_.rows);
    if (inside.empty()) return;
    const cv::Mat ink = mask(inside - place.tl());
    cv::Mat target = pixels_(inside);
    for (int y = 0; y < target.rows; ++y)
        for (int x = 0; x < target.cols; ++x) {
            const double a = ink.at<uchar>(y, x) / 255.0;
            cv::Vec3b& pixel = target.at<cv::Vec3b>(y, x);
            const std::array<double, 3> ink_bgr{color.b, color.g, color.r};
            for (int k = 0; k < 3; ++k)
                pixel[k] =
                    static_cast<uchar>(std::lround(a * ink_bgr[static_cast<std::size_t>(k)] + (1.0 - a) * pixel[k]));
        }
}

void Canvas::paste(const cv::Mat& image, cv::Point2d at) {
    const cv::Rect place(static_cast<int>(at.x * kScale), static_cast<int>(at.y * kScale), image.cols, image.rows);
    const cv::Rect inside = place & cv::Rect(0, 0, pixels_.cols, pixels_.rows);
    if (!inside.empty()) image(inside - place.tl()).copyTo(pixels_(inside));
}

cv::Mat Canvas::image() const {
    cv::Mat out;
    cv::resize(pixels_, out, {width_, height_}, 0.0, 0.0, cv::INTER_AREA);
    return out;
}

Status Canvas::save(const std::filesystem::path& file) const {
    try {
        if (cv::imwrite(file.string(), image())) return {};
        return host_fault(file.string() + ": cannot be written (folder missing, no permission or disk full)");
    } catch (const cv::Exception& e) {
        return host_fault(file.string() + ": cannot be written: " + e.what());
    }
}

std::vector<double> round_ticks(double low, double high, int about) {
    if (!(high > low) || !std::isfinite(high - low)) return {low};
    const double raw = (high - low) / std::max(about, 1);
    const double power = std::pow(10.0, std::floor(std::log10(raw)));
    double step = 10.0 * power;
    for (const double factor : {1.0, 2.0, 5.0})
        if (factor * power >= raw * 0.999) {
            step = factor * power;
            break;
        }
    std::vector<double> ticks;
    for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1.0)
        ticks.push_back(i == 0.0 ? 0.0 : i * step);
    return ticks;
}

std::vector<double> log_ticks(double low, double high) {
    std::vector<double> ticks;
    if (!(low > 0.0) || !(high > low)) return ticks;
    const bool fine = high / low < 1e3;
    for (double exponent = std::floor(std::log10(low)); exponent <= std::ceil(std::log10(high)); exponent += 1.0)
        for (const double factor : {1.0, 2.0, 5.0}) {
            const double tick = factor * std::pow(10.0, exponent);
            if ((factor == 1.0 || fine) && tick >= low * (1.0 - 1e-9) && tick <= high * (1.0 + 1e-9))
                ticks.push_back(tick);
        }
    return ticks;
}

std::string tick_text(double value, double step) {
    char buffer[40];
    const double size = std::max(std::abs(value), std::abs(step));
    if (size >= 1e6 || (size > 0.0 && std::abs(step) < 1e-4)) {
        std::snprintf(buffer, sizeof buffer, "%.3g", value);
        return buffer;
    }
    const int decimals = step > 0.0 ? std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9))) : 3;
    std::snprintf(buffer, sizeof buffer, "%.*f", decimals, value);
    return buffer;
}

}  // namespace teres::tools
