#include "plugins/diagnosis/recording.h"

#include <algorithm>
#include <cmath>

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

void Recording::hold_out_markers() {
    first_held_frame = num_frames;
    held_markers.clear();
    fit_rows.clear();
    held_rows.clear();
    for (std::size_t m = kHeldMarkers / 2; m < num_markers; m += kHeldMarkers)
        held_markers.push_back(static_cast<std::int32_t>(m));
    for (const Eigen::Index row : seen_rows())
        (marker_of(row) % kHeldMarkers == kHeldMarkers / 2 ? held_rows : fit_rows).push_back(row);
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
