// The last seconds of a stream as a case folder, so that what happened live can be diagnosed as a recording.
#pragma once

#include <cstdint>
#include <deque>

#include "core/case/case.h"
#include "core/result.h"
#include "teres/markers_t.hpp"
#include "teres/tool_loads_t.hpp"

namespace teres::tools {

class StreamWindow {
  public:
    /// Keeps `length_s` of MARKERS and TOOL_LOADS about the body of `base`. [s]
    StreamWindow(Case base, double length_s);

    /// A stamp before the newest one begins the window anew (a recording that is played in a loop).
    void add(const markers_t& message);
    void add(const tool_loads_t& message);

    std::int64_t newest_us() const { return markers_.empty() ? 0 : markers_.back().header.capture_stamp_us; }

    /// Body, ligament, supports and noise of the base, observations and loads of the stream from `from_us` on; at most
    /// max_frames frames of a quasi-static body, evenly taken. t_s = 0 is the first frame.
    /// Errors: fewer than 8 frames (kNotUsable).
    Result<Case> cut(std::int64_t from_us, std::size_t max_frames) const;

  private:
    void add_loads(Case& c, std::int64_t stamp_us, double t_s) const;

    Case base_;
    std::int64_t length_us_;
    std::deque<markers_t> markers_;  // oldest first
    std::deque<tool_loads_t>
        loads_;  // oldest first; the first is not newer than the first of markers_ where there is one
};

}  // namespace teres::tools
