// Round dots of about known size, dark or bright against what surrounds them, with sub-pixel centres.
//
//     l = log(1 + g/6)                              brightness ratios: as good in a shadow as in the light
//     dot pixel:  ±(local mean - l) > log contrast, local mean over a window of 2.5 dot diameters
//     centre:     Σ w p / Σ w,  w = max(0, ±(1 - g / b)),  b: plane through the brightness around the dot
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/camera/camera_model.h"

namespace teres {

struct Blob {
    Pixel center;
    double area_px = 0.0;  ///< Σ w / max w: fractions of pixels count
};

struct BlobOptions {
    bool bright = false;
    double diameter_px = 12.0;  ///< of a dot seen face on
    double contrast = 1.8;      ///< brightness ratio between surroundings and dot, > 1
};

/// [loop] `region`: where to look.
void find_blobs(const cv::Mat& grey, const cv::Rect& region, const BlobOptions& options, std::vector<Blob>& blobs);

}  // namespace teres
