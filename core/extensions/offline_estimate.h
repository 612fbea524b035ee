// What the estimator makes of a whole recording, for offline commands: each frame's parameters given all
// frames, not only those before it. Needs the setting estimator.keep_recording. Crosses a plugin boundary:
// spans of doubles, plain structs, no exceptions, no ownership.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace teres {

class OfflineEstimate {
  public:
    static constexpr const char* kId = "teres.offline_estimate/1";

    virtual std::size_t num_parameters() const = 0;                    ///< [setup] as the forward model's
    virtual std::size_t num_attachment_nodes() const = 0;              ///< [setup] as the forward model's
    virtual std::size_t num_frames() const = 0;                        ///< [setup] frames kept so far
    virtual std::int64_t frame_stamp_us(std::size_t frame) const = 0;  ///< [setup]

    /// [setup] Smooths all frames kept so far; `passes` further passes linearise the model about the result
    /// (quasi-static models only, else none). `progress` (may be null) gets the part done, in [0, 1]. False:
    /// no frame was kept.
    virtual bool smooth(int passes, void (*progress)(void* user, double part), void* user) noexcept = 0;

    // [setup] After smooth(). Spans have num_parameters() and num_attachment_nodes() entries.
    /// Physical median and standard deviation; observability = 1 - variance / prior variance in filter
    /// coordinates.
    virtual void parameters(std::size_t frame, std::span<double> mean, std::span<double> stdev,
                            std::span<double> observability) const = 0;
    virtual void attachment(std::size_t frame, std::span<double> probability) const = 0;

  protected:
    ~OfflineEstimate() = default;
};

}  // namespace teres
