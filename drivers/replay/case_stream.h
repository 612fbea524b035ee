// A case folder as a stream: for each time in observations.csv one TOOL_LOADS (if the case has loads or
// tools) and one MARKERS message, in that order. Coordinates keep every bit of the reader's; NaN (lost
// marker) is passed on as NaN.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "core/case/case.h"
#include "core/case/load_tracks.h"
#include "core/result.h"
#include "drivers/replay/stream.h"
#include "teres/markers_t.hpp"

namespace teres {

inline constexpr const char* kMarkersChannel = "MARKERS";
inline constexpr const char* kToolLoadsChannel = "TOOL_LOADS";

class CaseStream final : public Stream {
  public:
    /// [setup] Errors (kInvalidInput): no observations.
    static Result<std::unique_ptr<CaseStream>> make(const Case& from);

    bool next(Packet& packet) override;
    void loop() override;
    std::int64_t start_us() const override { return stamp_us(0); }
    std::size_t num_frames() const { return frames_.size(); }

  private:
    explicit CaseStream(const Case& from);
    struct Frame {
        double t_s;
        std::size_t begin, end;  // rows
    };
    std::int64_t stamp_us(std::size_t frame) const;

    std::string frame_id_;
    double sigma_m_;
    std::vector<PositionSample> rows_;
    std::vector<Frame> frames_;
    LoadTracks loads_;
    std::size_t frame_ = 0;
    bool loads_done_ = false;
    std::int64_t offset_us_ = 0;  // of this pass
    std::int64_t period_us_ = 0;  // length of one pass
    std::int64_t sequence_ = 0;
    markers_t markers_;
    tool_loads_t tool_loads_;
};

}  // namespace teres
