// The observations of one recording in blocks: what is fitted and chosen with, and what is only ever reported on.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <string>
#include <vector>

#include "core/extensions/gap_diagnosis.h"
#include "core/result.h"

namespace teres {

struct Recording {
    std::string name;
    Eigen::VectorXd observed;             ///< full trajectory [m], NaN where lost
    double noise_m = 0.0;                 ///< stated, per axis
    std::vector<Eigen::Index> fit_rows;   ///< seen entries that may be fitted
    std::vector<Eigen::Index> held_rows;  ///< seen entries that never are
    std::size_t num_markers = 0, num_frames = 0;
    std::size_t first_held_frame = 0;        ///< num_frames if markers are held out instead
    std::vector<std::int32_t> held_markers;  ///< indices; empty if frames are held out

    std::size_t marker_of(Eigen::Index row) const { return static_cast<std::size_t>(row) % (3 * num_markers) / 3; }
    std::size_t frame_of(Eigen::Index row) const { return static_cast<std::size_t>(row) / (3 * num_markers); }
    /// Holds out the last sixth of the frames.
    void hold_out_frames() { hold_out_frames(num_frames - std::max<std::size_t>(1, num_frames / kHeldShare)); }
    /// Holds out this frame and those after it.
    void hold_out_frames(std::size_t first);
    /// Holds out markers in all frames: for recordings in which something happens late. Every fifth one in the order of
    /// its gap to `simulated`, so that those held out see as much of it as those fitted; never the two worst, which may
    /// have slipped or been exchanged.
    void hold_out_markers(const Eigen::VectorXd& simulated);
    std::vector<Eigen::Index> seen_rows() const;

    static constexpr std::size_t kHeldShare = 6;  ///< one frame of six is held out, at the end
};

/// All of a recording of which only the beginning is fitted, for predictions.
GapRecording whole_of(GapRecording recording);

/// Errors (kInvalidInput): fewer than 3 markers or 8 frames, a marker that is never seen, stated noise not positive,
/// observations kilometres away from the model (wrong units).
Result<Recording> make_recording(const GapRecording& from);

}  // namespace teres
