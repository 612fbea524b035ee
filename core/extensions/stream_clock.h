// Offered by a driver that plays a recording back: the clock of the recording, which then is the clock of
// every unit (teres_host.now_us), so that a replay does not depend on how fast the machine is.
#pragma once

#include <cstdint>

namespace teres {

class StreamClock {
  public:
    static constexpr const char* kId = "teres.stream_clock/1";

    /// [loop] Capture stamp of the newest published frame [us]; before the first frame, the start of the
    /// recording.
    virtual std::int64_t now_us() const noexcept = 0;

  protected:
    ~StreamClock() = default;
};

}  // namespace teres
