#include "plugins/observation/blob_detector.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace teres {
namespace {

constexpr double kSmallest = 0.15, kLargest = 2.2;  // area over that of a dot seen face on
constexpr double kThinnest = 0.22;                  // minor over major axis
constexpr double kFullness = 0.80;                  // area over that of the ellipse with the same moments
constexpr int kRim = 3;                             // pixels around the bounding box
constexpr double kLevelsPerDoubling = 36.0;         // of the logarithmic picture
constexpr double kDarkGrey = 6.0;                   // below it the logarithm flattens: noise stays small

const cv::Mat& log_table() {
    static const cv::Mat table = [] {
        cv::Mat t(1, 256, CV_8U);
        for (int g = 0; g < 256; ++g)
            t.at<std::uint8_t>(g) = cv::saturate_cast<std::uint8_t>(kLevelsPerDoubling * std::log2(1.0 + g / kDarkGrey));
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

        std::vector<std::uint8_t> rim;
        for (int v = 0; v < outer.height; ++v)
            for (int u = 0; u < outer.width; ++u)
                if (u == 0 || v == 0 || u == outer.width - 1 || v == outer.height - 1)
                    rim.push_back(view.at<std::uint8_t>(outer.y + v, outer.x + u));
        std::nth_element(rim.begin(), rim.begin() + std::ssize(rim) / 2, rim.end());
        const double level = rim[rim.size() / 2], sign = options.bright ? -1.0 : 1.0;
        double sum = 0.0, sum_u = 0.0, sum_v = 0.0, deepest = 0.0;
        for (int v = 0; v < outer.height; ++v)
            for (int u = 0; u < outer.width; ++u) {
                const int label = labels.at<int>(outer.y + v, outer.x + u);
                if (label != i && label != 0) continue;
                const double depth = sign * (level - view.at<std::uint8_t>(outer.y + v, outer.x + u));
                if (label == 0 && depth < 0.5 * contrast) continue;  // texture and noise beside the dot
                const double w = std::max(0.0, depth);
                sum += w;
                sum_u += w * u;
                sum_v += w * v;
                deepest = std::max(deepest, w);
            }
        if (!(deepest >= contrast)) continue;
        blobs.push_back({{box.x + outer.x + sum_u / sum, box.y + outer.y + sum_v / sum}, sum / deepest});
    }
}

}  // namespace teres
