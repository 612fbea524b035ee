// An image to draw on, anti-aliased by drawing at twice the size. Coordinates are pixels of the final image,
// y down.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

#include "core/result.h"
#include "tools/color.h"

namespace teres::tools {

enum class Align { kLeft, kCenter, kRight };

class Canvas {
  public:
    Canvas(int width_px, int height_px);

    int width() const { return width_; }
    int height() const { return height_; }
    void line(cv::Point2d a, cv::Point2d b, Color color, double thickness_px = 1.5);
    void polyline(std::span<const cv::Point2d> points, Color color, double thickness_px = 2.0, bool dashed = false);
    /// Filled polygon, mixed with what is below by `opacity` (0..1).
    void polygon(std::span<const cv::Point2d> points, Color color, double opacity = 1.0);
    void rectangle(cv::Rect2d box, Color color, double opacity = 1.0);
    void frame(cv::Rect2d box, Color color, double thickness_px = 1.5);
    void dot(cv::Point2d center, double radius_px, Color color);
    /// Text whose capitals are `height_px` high, vertically centred on `at`. ASCII only ('?' for the rest).
    void text(cv::Point2d at, const std::string& text, double height_px, Align align = Align::kLeft,
              Color color = kInk);
    /// Text that reads upwards, centred on `at`.
    void vertical_text(cv::Point2d at, const std::string& text, double height_px, Color color = kInk);
    static double text_width(const std::string& text, double height_px);
    /// Copies an image (8-bit BGR, twice the final size) with its corner at `at`.
    void paste(const cv::Mat& image, cv::Point2d at);
    static constexpr int kScale = 2;  ///< pixels drawn per final pixel

    cv::Mat image() const;  ///< the final image, 8-bit BGR
    /// PNG. Errors: kHostFault if it cannot be written.
    Status save(const std::filesystem::path& file) const;

  private:
    int width_, height_;
    cv::Mat pixels_;
};

/// Tick positions at round numbers (1, 2, 5 times a power of ten) that lie within [low, high].
std::vector<double> round_ticks(double low, double high, int about = 5);
/// Ticks of a logarithmic axis: powers of ten, with 2 and 5 where fewer than three decades are shown.
std::vector<double> log_ticks(double low, double high);
/// A tick as text, with as many decimals as `step` needs.
std::string tick_text(double value, double step);

}  // namespace teres::tools
