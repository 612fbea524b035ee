#include "plugins/diagnosis/recording.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace teres {
namespace {

constexpr std::size_t kMinMarkers = 3, kMinFrames = 8;
constexpr std::size_t kHeldMarkers = 5;  // one marker of five

}  // namespace

std::vector<Eigen::Index> Recording::seen_rows() const {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index row = 0; row < observed.size(); ++row)
        if (std::isfinite(observed(row))) rows.push_back(row);
    return rows;
}

void Recording::hold_out_frames(std::size_t first) {
    first_held_frame = first;
    held_markers.clear();
    fit_rows.clear();
    held_rows.clear();
    for (const Eigen::Index row : seen_rows()) (frame_of(row) < first_held_frame ? fit_rows : held_rows).push_back(row);
}

void Recording::hold_out_markers(const Eigen::VectorXd& simulated) {
    std::vector<double> gap(num_markers), count(num_markers);
    for (const Eigen::Index row : seen_rows()) {
        gap[marker_of(row)] += std::pow(observed(row) - simulated(row), 2);
        count[marker_of(row)] += 1.0;
    }
    for (std::size_t m = 0; m < num_markers; ++m) gap[m] /= std::max(1.0, count[m]);
    std::vector<std::int32_t> order(num_markers);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
        return gap[static_cast<std::size_t>(a)] > gap[static_cast<std::size_t>(b)];
    });
    first_held_frame = num_frames;
    held_markers.clear();
    fit_rows.clear();
    held_rows.clear();
    for (std::size_t rank = kHeldMarkers / 2; rank < num_markers; rank += kHeldMarkers)
        held_markers.push_back(order[rank]);
    std::sort(held_markers.begin(), held_markers.end());
    for (const Eigen::Index row : seen_rows()) {
        const bool held =
            std::binary_search(held_markers.begin(), held_markers.end(), static_cast<std::int32_t>(marker_of(row)));
        (held ? held_rows : fit_rows).push_back(row);
    }
}

GapRecording whole_of(GapRecording recording) {
    if (recording.whole_mechanics == nullptr) return recording;
    recording.mechanics = recording.whole_mechanics;
    recording.sensors = recording.whole_sensors;
    recording.observed_m = recording.whole_observed_m;
    return recording;
}

Result<Recording> make_recording(const GapRecording& from) {
    Recording r;
    r.name = from.name;
    r.num_markers = from.mechanics->num_markers();
    r.num_frames = from.mechanics->num_frames();
    r.noise_m = from.noise_sigma_m;
    r.observed =
        Eigen::Map<const Eigen::VectorXd>(from.observed_m.data(), static_cast<Eigen::Index>(from.observed_m.size()));
    if (r.num_markers < kMinMarkers)
        return invalid_input(r.name + ": " + std::to_string(r.num_markers) + " markers; a diagnosis needs at least " +
                             std::to_string(kMinMarkers));
    if (r.num_frames < kMinFrames)
        return invalid_input(r.name + ": " + std::to_string(r.num_frames) + " frames; a diagnosis needs at least " +
                             std::to_string(kMinFrames));
    if (from.observed_m.size() != 3 * r.num_markers * r.num_frames)
        return invalid_input(r.name + ": observations do not match the model's markers and frames");
    if (!(r.noise_m > 0.0))
        return invalid_input(r.name + ": sensor.noise_sigma_m is " + std::to_string(r.noise_m) +
                             "; a diagnosis needs the stated noise, above 0");
    for (std::size_t m = 0; m < r.num_markers; ++m) {
        bool seen = false;
        for (std::size_t f = 0; f < r.num_frames; ++f)
            seen = seen || std::isfinite(r.observed(static_cast<Eigen::Index>(3 * (f * r.num_markers + m))));
        if (!seen)
            return invalid_input(r.name + ": marker " + std::to_string(from.mechanics->marker_id(m)) +
                                 " is lost throughout; take it out of markers_rest.csv and observations.csv");
    }
    r.hold_out_frames();
    return r;
}

}  // namespace teres
