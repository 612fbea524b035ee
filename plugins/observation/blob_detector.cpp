#include "plugins/observation/blob_detector.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace teres {
namespace {

constexpr double kSmallest = 0.15, kLargest = 2.2;  // area over that of a dot seen face on
constexpr double kThinnest = 0.22;                  // minor over major axis
constexpr double kFullness = 0.80;                  // area over that of the ellipse with the same moments
constexpr double kLeastCover = 0.1;                 // of a pixel beside the dot; less is texture and noise
constexpr int kRim = 3;                             // pixels around the bounding box
constexpr double kSlopeRidge = 10.0;                // px²: a one-sided rim tells no slope
constexpr double kLevelsPerDoubling = 36.0;         // of the logarithmic picture
constexpr double kDarkGrey = 6.0;                   // below it the logarithm flattens: noise stays small

const cv::Mat& log_table() {
    static const cv::Mat table = [] {
        cv::Mat t(1, 256, CV_8U);
        for (int g = 0; g < 256; ++g)
            t.at<std::uint8_t>(g) =
                cv::saturate_cast<std::uint8_t>(kLevelsPerDoubling * std::log2(1.0 + g / kDarkGrey));
        return t;
    }();
    return table;
}

struct Shape {
    double axis_ratio, fullness;
};

Shape shape_of(const cv::Moments& m) {
    const double a = m.mu20 / m.m00, b = m.mu11 / m.m00, c = m.mu02 / m.m00;
    const double middle = 0.5 * (a + c), spread = std::sqrt(0.25 * (a - c) * (a - c) + b * b);
    const double major = middle + spread + 1.0 / 12.0, minor = std::max(0.0, middle - spread) + 1.0 / 12.0;
    // A filled ellipse has second moments (half axis)²/4, area π a b.
    return {std::sqrt(minor / major), m.m00 / (4.0 * std::numbers::pi * std::sqrt(major * minor))};
}

// Brightness of the surroundings under a dot: plane through those pixels of the rim that are like their median, so that
// shading does not pull the centre and another surface behind an edge does not count.
struct Backdrop {
    double g, gu, gv, u0, v0;
    double at(int u, int v) const { return std::max(1.0, g + gu * (u - u0) + gv * (v - v0)); }
};

Backdrop backdrop_of(const cv::Mat& grey, const cv::Mat& log_view, const cv::Rect& box, double alike) {
    std::vector<cv::Point> rim;
    for (int u = box.x; u < box.x + box.width; ++u)
        for (const int v : {box.y, box.y + box.height - 1}) rim.emplace_back(u, v);
    for (int v = box.y + 1; v < box.y + box.height - 1; ++v)
        for (const int u : {box.x, box.x + box.width - 1}) rim.emplace_back(u, v);
    std::vector<std::uint8_t> levels;
    for (const cv::Point& p : rim) levels.push_back(log_view.at<std::uint8_t>(p));
    std::nth_element(levels.begin(), levels.begin() + std::ssize(levels) / 2, levels.end());
    const double median = levels[levels.size() / 2];

    Backdrop plane{0.0, 0.0, 0.0, box.x + 0.5 * (box.width - 1), box.y + 0.5 * (box.height - 1)};
    Eigen::Matrix3d A = Eigen::Vector3d(0.0, kSlopeRidge, kSlopeRidge).asDiagonal();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const cv::Point& p : rim) {
        if (std::abs(log_view.at<std::uint8_t>(p) - median) > alike) continue;
        const Eigen::Vector3d row(1.0, p.x - plane.u0, p.y - plane.v0);
        A += row * row.transpose();
        b += grey.at<std::uint8_t>(p) * row;
    }
    const Eigen::Vector3d fit = A.ldlt().solve(b);
    plane.g = fit[0];
    plane.gu = fit[1];
    plane.gv = fit[2];
    return plane;
}

// A pixel that the dot covers in part touches one that it fills.
bool touches(const cv::Mat& labels, int label, int u, int v) {
    const cv::Rect around = cv::Rect(u - 1, v - 1, 3, 3) & cv::Rect(0, 0, labels.cols, labels.rows);
    for (int row = around.y; row < around.y + around.height; ++row)
        for (int column = around.x; column < around.x + around.width; ++column)
            if (labels.at<int>(row, column) == label) return true;
    return false;
}

}  // namespace

void find_blobs(const cv::Mat& grey, const cv::Rect& region, const BlobOptions& options, std::vector<Blob>& blobs) {
    blobs.clear();
    const cv::Rect box = region & cv::Rect(0, 0, grey.cols, grey.rows);
    if (box.area() == 0) return;
    cv::Mat view;
    cv::LUT(grey(box), log_table(), view);
    const double contrast = kLevelsPerDoubling * std::log2(std::max(1.01, options.contrast));
    const int window = 2 * static_cast<int>(std::lround(1.25 * options.diameter_px)) + 1;
    cv::Mat mask, labels, stats, centers;
    cv::adaptiveThreshold(view, mask, 255, cv::ADAPTIVE_THRESH_MEAN_C,
                          options.bright ? cv::THRESH_BINARY : cv::THRESH_BINARY_INV, window,
                          options.bright ? -contrast : contrast);
    const int count = cv::connectedComponentsWithStats(mask, labels, stats, centers, 4, CV_32S);
    const double full = 0.25 * std::numbers::pi * options.diameter_px * options.diameter_px;
    for (int i = 1; i < count; ++i) {
        const double area = stats.at<int>(i, cv::CC_STAT_AREA);
        if (area < kSmallest * full || area > kLargest * full) continue;
        const cv::Rect inner(stats.at<int>(i, cv::CC_STAT_LEFT), stats.at<int>(i, cv::CC_STAT_TOP),
                             stats.at<int>(i, cv::CC_STAT_WIDTH), stats.at<int>(i, cv::CC_STAT_HEIGHT));
        const Shape shape = shape_of(cv::moments(labels(inner) == i, true));
        if (shape.axis_ratio < kThinnest || shape.fullness < kFullness) continue;
        const cv::Rect outer(inner.x - kRim, inner.y - kRim, inner.width + 2 * kRim, inner.height + 2 * kRim);
        if ((outer & cv::Rect(0, 0, box.width, box.height)) != outer) continue;  // cut by the image's border

        const Backdrop backdrop = backdrop_of(grey(box), view, outer, 0.5 * contrast);
        const double sign = options.bright ? -1.0 : 1.0;
        double sum = 0.0, sum_u = 0.0, sum_v = 0.0, deepest = 0.0;
        for (int v = outer.y; v < outer.y + outer.height; ++v)
            for (int u = outer.x; u < outer.x + outer.width; ++u) {
                const int label = labels.at<int>(v, u);
                if (label != i && (label != 0 || !touches(labels, i, u, v))) continue;
                const double w = sign * (1.0 - grey.at<std::uint8_t>(box.y + v, box.x + u) / backdrop.at(u, v));
                if (w <= 0.0 || (label == 0 && w < kLeastCover)) continue;
                sum += w;
                sum_u += w * u;
                sum_v += w * v;
                deepest = std::max(deepest, w);
            }
        if (!(deepest >= 1.0 - 1.0 / options.contrast)) continue;
        blobs.push_back({{box.x + sum_u / sum, box.y + sum_v / sum}, sum / deepest});
    }
}

}  // namespace teres
