#include "tools/score.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "core/case/geometry.h"
#include "core/case/text_file.h"

namespace teres::tools {
namespace {

constexpr double kMaxTimeTolerance_s = 1e-3;
constexpr std::size_t kListed = 10;

// Linear interpolation between order statistics; `sorted` is not empty.
double quantile(const std::vector<double>& sorted, double share) {
    const double at = share * static_cast<double>(sorted.size() - 1);
    const auto i = static_cast<std::size_t>(at);
    const double f = at - static_cast<double>(i);
    return i + 1 < sorted.size() ? sorted[i] + f * (sorted[i + 1] - sorted[i]) : sorted[i];
}

}  // namespace

Result<Score> score_prediction(std::span<const PositionSample> truth, std::span<const PositionSample> prediction) {
    Score score;
    std::set<std::int32_t> ids;
    std::map<double, std::vector<const PositionSample*>> frames;
    for (const PositionSample& sample : truth) {
        if (!is_finite(sample.position_m)) continue;
        ids.insert(sample.id);
        frames[sample.t_s].push_back(&sample);
    }
    if (ids.empty()) return invalid_input("the truth holds no position");
    score.num_points = ids.size();
    double tolerance_s = kMaxTimeTolerance_s;
    for (auto it = frames.begin(), next = std::next(it); next != frames.end(); ++it, ++next)
        tolerance_s = std::min(tolerance_s, 0.25 * (next->first - it->first));

    std::map<std::pair<double, std::int32_t>, const PositionSample*> predicted;  // by the truth's time
    for (const PositionSample& sample : prediction) {
        if (ids.count(sample.id) == 0)
            return invalid_input("point_id " + std::to_string(sample.id) + " at t_s = " + to_text(sample.t_s) +
                                 " is not a point of the truth");
        const auto frame = frames.lower_bound(sample.t_s - tolerance_s);
        if (frame == frames.end() || frame->first > sample.t_s + tolerance_s) {
            ++score.num_ignored;
            continue;
        }
        if (!predicted.emplace(std::pair{frame->first, sample.id}, &sample).second)
            return invalid_input("point_id " + std::to_string(sample.id) + " at t_s = " + to_text(sample.t_s) +
                                 " is predicted twice");
    }

    std::vector<double> errors;
    double sum = 0.0, sum2 = 0.0;
    for (const auto& [t_s, samples] : frames) {
        FrameError frame{t_s, 0, 0.0, 0.0};
        for (const PositionSample* sample : samples) {
            const auto found = predicted.find({t_s, sample->id});
            if (found == predicted.end() || !is_finite(found->second->position_m)) {
                if (score.num_missing++ < kListed)
                    score.missing.push_back("point " + std::to_string(sample->id) + " at t_s = " + to_text(t_s) +
                                            (found == predicted.end() ? "" : " (NaN)"));
                continue;
            }
            const double error_mm = 1e3 * distance(sample->position_m, found->second->position_m);
            if (errors.empty() || error_mm > score.max_mm) {
                score.max_mm = error_mm;
                score.max_t_s = t_s;
                score.max_point_id = sample->id;
            }
            errors.push_back(error_mm);
            sum += error_mm;
            sum2 += error_mm * error_mm;
            frame.mean_mm += error_mm;
            frame.max_mm = std::max(frame.max_mm, error_mm);
            ++frame.num_points;
        }
        frame.mean_mm = frame.num_points > 0 ? frame.mean_mm / static_cast<double>(frame.num_points)
                                             : std::numeric_limits<double>::quiet_NaN();
        score.frames.push_back(frame);
        const double worst = score.frames[score.worst_frame].mean_mm;
        if (!(worst >= frame.mean_mm) && frame.num_points > 0) score.worst_frame = score.frames.size() - 1;
    }
    score.num_positions = errors.size();
    const double nan = std::numeric_limits<double>::quiet_NaN();
    if (errors.empty()) {
        score.mean_mm = score.rms_mm = score.median_mm = score.p95_mm = score.max_mm = nan;
        return score;
    }
    std::sort(errors.begin(), errors.end());
    const auto n = static_cast<double>(errors.size());
    score.mean_mm = sum / n;
    score.rms_mm = std::sqrt(sum2 / n);
    score.median_mm = quantile(errors, 0.5);
    score.p95_mm = quantile(errors, 0.95);
    return score;
}

}  // namespace teres::tools
