#include "tools/phantom/depth_sensor.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace teres::phantom {

cv::Mat DepthSensor::measure(const cv::Mat& distance_m) {
    cv::Mat noise(distance_m.size(), CV_32F), nearest, farthest;
    random_.fill(noise, cv::RNG::NORMAL, 0.0, 1.0);
    cv::GaussianBlur(noise, noise, cv::Size(), options_.correlation_px);
    cv::Scalar mean, spread;
    cv::meanStdDev(noise, mean, spread);
    noise *= options_.disparity_sigma_px / spread[0];
    const cv::Mat window = cv::Mat::ones(5, 5, CV_8U);
    cv::erode(distance_m, nearest, window);
    cv::dilate(distance_m, farthest, window);

    cv::Mat counts(distance_m.size(), CV_16U, cv::Scalar(0));
    for (int v = 0; v < counts.rows; ++v)
        for (int u = 0; u < counts.cols; ++u) {
            double z = distance_m.at<float>(v, u);
            if (!(z > 0.0)) continue;
            const double low = nearest.at<float>(v, u), high = farthest.at<float>(v, u);
            if (high - low > options_.edge_jump_m) {
                const double luck = random_.uniform(0.0, 1.0);
                if (luck < options_.hole_share) continue;
                if (luck < options_.hole_share + options_.flying_share) z = random_.uniform(low, high);
                if (!(z > 0.0)) continue;
            }
            const double disparity = std::round(32.0 * (f_b_ / z + noise.at<float>(v, u))) / 32.0;
            if (disparity <= 0.0 || disparity > 126.0) continue;
            counts.at<std::uint16_t>(v, u) = cv::saturate_cast<std::uint16_t>(f_b_ / disparity / options_.depth_unit_m);
        }
    return counts;
}

}  // namespace teres::phantom
