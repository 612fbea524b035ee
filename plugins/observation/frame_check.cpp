#include "plugins/observation/frame_check.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/camera/depth_codec.h"

namespace teres {
namespace {

constexpr double kDarkest = 6.0, kBrightest = 249.0;  // mean grey of a usable frame
constexpr double kMinDepthShare = 0.01;               // of the pixels
constexpr int kEmptyRowsShare = 4;                    // a quarter of the rows without signal: half a frame

// FNV-1a over at most about 8,000 bytes spread over the frame: sensor noise changes some of them in every new frame.
std::uint64_t fingerprint_of(const std::vector<std::uint8_t>& data) {
    std::uint64_t hash = 0xcbf29ce484222325ULL;
    const std::size_t stride = data.size() / 8000 + 1;
    for (std::size_t i = 0; i < data.size(); i += stride) hash = (hash ^ data[i]) * 0x100000001b3ULL;
    return hash;
}

// Depth changes from pixel to pixel by a few counts, not by multiples of 256.
bool bytes_exchanged(const cv::Mat& counts) {
    constexpr int kRowStep = 4, kRougher = 4;
    std::int64_t as_sent = 0, exchanged = 0;
    const auto swap = [](std::uint16_t x) { return static_cast<std::uint16_t>(x << 8 | x >> 8); };
    for (int v = 0; v < counts.rows; v += kRowStep)
        for (int u = 1; u < counts.cols; ++u) {
            const std::uint16_t a = counts.at<std::uint16_t>(v, u - 1), b = counts.at<std::uint16_t>(v, u);
            if (a == 0 || b == 0) continue;
            as_sent += std::abs(a - b);
            exchanged += std::abs(swap(a) - swap(b));
        }
    return as_sent > kRougher * exchanged;
}

int empty_rows_below(const cv::Mat& image) {
    int rows = 0;
    for (int v = image.rows - 1; v >= 0; --v, ++rows) {
        double low = 0.0, high = 0.0;
        cv::minMaxLoc(image.row(v), &low, &high);
        if (low != high) break;
    }
    return rows;
}

}  // namespace

const char* fault_name(FrameFault fault) {
    static constexpr std::array names{"without calibration",
                                      "of another serial number",
                                      "wrong size",
                                      "wrong fourcc",
                                      "wrong byte count",
                                      "wrong byte order",
                                      "undecodable",
                                      "half frame",
                                      "depth unit 0",
                                      "black",
                                      "saturated",
                                      "frozen",
                                      "repeated",
                                      "late",
                                      "unpaired",
                                      "cameras swapped"};
    static_assert(names.size() == static_cast<std::size_t>(FrameFault::kCount));
    return names[static_cast<std::size_t>(fault)];
}

std::optional<cv::Mat> FrameCheck::take(const image_t& frame) noexcept {
    FrameFault fault = FrameFault::kUndecodable;
    try {
        cv::Mat image;
        const auto found = examine(frame, image);
        if (!found) return image;
        fault = *found;
    } catch (...) {  // OpenCV on hostile data, or out of memory
    }
    count(fault);
    return std::nullopt;
}

std::optional<FrameFault> FrameCheck::examine(const image_t& frame, cv::Mat& image) {
    if (const auto fault = examine_time(frame)) return fault;
    if (!info_) return FrameFault::kNoCalibration;
    if (!info_->serial.empty() && !frame.serial.empty() && frame.serial != info_->serial)
        return FrameFault::kOtherSerial;
    if (frame.width_px != info_->camera.width_px || frame.height_px != info_->camera.height_px)
        return FrameFault::kWrongSize;
    if (kind_ == Kind::kDepth && !(info_->depth_unit_m > 0.0)) return FrameFault::kNoDepthUnit;
    if (const auto fault = decode(frame, image)) return fault;
    const std::uint64_t fingerprint = fingerprint_of(frame.data);
    const bool frozen = fingerprint == fingerprint_;
    fingerprint_ = fingerprint;
    if (const auto fault = examine_content(image)) return fault;
    if (frozen) return FrameFault::kFrozen;
    return std::nullopt;
}

std::optional<FrameFault> FrameCheck::examine_time(const image_t& frame) {
    const std::int64_t stamp_us = frame.header.capture_stamp_us;
    if (stamp_us_ && stamp_us == *stamp_us_) return FrameFault::kRepeated;
    if (stamp_us_ && stamp_us < *stamp_us_) return FrameFault::kLate;
    stamp_us_ = stamp_us;
    return std::nullopt;
}

std::optional<FrameFault> FrameCheck::decode(const image_t& frame, cv::Mat& image) const {
    const bool depth = kind_ == Kind::kDepth;
    auto* data = const_cast<std::uint8_t*>(frame.data.data());  // cv::Mat has no const view; only read
    const cv::Size size(frame.width_px, frame.height_px);
    if (depth && frame.fourcc == "RVL ") {
        image.create(size, CV_16U);
        return decode_depth(frame.data, {image.ptr<std::uint16_t>(), image.total()})
                   ? std::nullopt
                   : std::optional(FrameFault::kHalfFrame);
    }
    if (!depth && frame.fourcc == "MJPG") {
        const std::size_t n = frame.data.size();
        if (n < 4 || frame.data[0] != 0xff || frame.data[1] != 0xd8) return FrameFault::kUndecodable;
        if (frame.data[n - 2] != 0xff || frame.data[n - 1] != 0xd9) return FrameFault::kHalfFrame;
        image = cv::imdecode(cv::Mat(1, static_cast<int>(n), CV_8U, data), cv::IMREAD_GRAYSCALE);
        if (image.empty()) return FrameFault::kUndecodable;
        return image.size() == size ? std::nullopt : std::optional(FrameFault::kWrongSize);
    }
    struct Layout {
        const char* fourcc;
        int bytes_per_pixel, type, to_grey;
    };
    static constexpr std::array<Layout, 4> colors{{{"RGB3", 3, CV_8UC3, cv::COLOR_RGB2GRAY},
                                                   {"BGR3", 3, CV_8UC3, cv::COLOR_BGR2GRAY},
                                                   {"YUYV", 2, CV_8UC2, cv::COLOR_YUV2GRAY_YUYV},
                                                   {"GREY", 1, CV_8UC1, -1}}};
    Layout layout{"Z16 ", 2, CV_16UC1, -1};
    if (!depth) {
        const auto found =
            std::find_if(colors.begin(), colors.end(), [&](const Layout& l) { return frame.fourcc == l.fourcc; });
        if (found == colors.end()) return FrameFault::kWrongFourcc;
        layout = *found;
    } else if (frame.fourcc != layout.fourcc) {
        return FrameFault::kWrongFourcc;
    }
    const std::int64_t stride = frame.row_stride_bytes;
    if (stride < std::int64_t{layout.bytes_per_pixel} * frame.width_px) return FrameFault::kWrongBytes;
    if (static_cast<std::int64_t>(frame.data.size()) != stride * frame.height_px) return FrameFault::kWrongBytes;
    const cv::Mat view(size, layout.type, data, static_cast<std::size_t>(stride));
    if (layout.to_grey >= 0)
        cv::cvtColor(view, image, layout.to_grey);
    else
        image = view.clone();
    return std::nullopt;
}

std::optional<FrameFault> FrameCheck::examine_content(const cv::Mat& image) const {
    if (kind_ == Kind::kDepth) {
        const double share = static_cast<double>(cv::countNonZero(image)) / static_cast<double>(image.total());
        if (share < kMinDepthShare) return FrameFault::kBlack;
        if (bytes_exchanged(image)) return FrameFault::kByteOrder;
    } else {
        const double mean = cv::mean(image)[0];
        if (mean < kDarkest) return FrameFault::kBlack;
        if (mean > kBrightest) return FrameFault::kSaturated;
    }
    if (empty_rows_below(image) > image.rows / kEmptyRowsShare) return FrameFault::kHalfFrame;
    return std::nullopt;
}

}  // namespace teres
