// The gate that every camera frame passes: a bad one is named and counted, never used, never fatal.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/camera/camera_model.h"
#include "teres/image_t.hpp"

namespace teres {

enum class FrameFault {
    kNoCalibration,
    kOtherSerial,  ///< the calibration is of another device
    kWrongSize,
    kWrongFourcc,
    kWrongBytes,  ///< byte count or row stride do not fit the size
    kByteOrder,   ///< raw depth with its bytes exchanged
    kUndecodable,
    kHalfFrame,  ///< compressed data without end, or the lower rows are empty
    kNoDepthUnit,
    kBlack,  ///< or without any depth
    kSaturated,
    kFrozen,    ///< new stamp, old content
    kRepeated,  ///< stamp of the frame before
    kLate,      ///< stamp older than that of the frame before
    kUnpaired,  ///< no frame of the other camera at that time
    kSwapped,   ///< left and right camera exchanged
    kCount
};
const char* fault_name(FrameFault fault);

class FrameCheck {
  public:
    enum class Kind { kGrey, kDepth };
    explicit FrameCheck(Kind kind) : kind_(kind) {}

    void set_info(const StreamInfo& info) { info_ = info; }
    const std::optional<StreamInfo>& info() const { return info_; }

    /// [loop] 8-bit grey or 16-bit depth counts; nothing if the frame is bad (counted). Never throws.
    std::optional<cv::Mat> take(const image_t& frame) noexcept;
    void count(FrameFault fault) { ++faults_[static_cast<std::size_t>(fault)]; }
    std::int64_t count_of(FrameFault fault) const { return faults_[static_cast<std::size_t>(fault)]; }

  private:
    std::optional<FrameFault> examine(const image_t& frame, cv::Mat& image);
    std::optional<FrameFault> examine_time(const image_t& frame);
    std::optional<FrameFault> decode(const image_t& frame, cv::Mat& image) const;
    std::optional<FrameFault> examine_content(const cv::Mat& image) const;

    Kind kind_;
    std::optional<StreamInfo> info_;
    std::optional<std::int64_t> stamp_us_;
    std::uint64_t fingerprint_ = 0;
    std::array<std::int64_t, static_cast<std::size_t>(FrameFault::kCount)> faults_{};
};

}  // namespace teres
