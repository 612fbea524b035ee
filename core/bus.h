// The message bus: LCM behind a small interface. Providers: memq:// (in process), udpm:// (multicast), file:// (logs).
// Packets are not trusted: size is checked against the subscriber's bound, nothing thrown crosses liblcm's frames.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "core/result.h"

namespace teres {

/// Larger messages are refused when published and when received.
inline constexpr std::size_t kMaxMessageBytes = std::size_t{64} << 20;

struct BusCounters {
    std::int64_t published = 0;
    std::int64_t received = 0;
    std::int64_t refused = 0;  ///< above the size bound, memq:// full, publish failed, or the handler threw
};

/// All calls from one thread.
class Bus {
  public:
    /// `receive_us`: monotonic clock when the message arrived; file://: the stamp in the log.
    using Handler =
        std::function<void(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t receive_us)>;

    /// [setup] Errors (kHostFault): provider unknown or refused (e.g. no multicast route), with the remedy in the text.
    static Result<Bus> open(const std::string& url);
    Bus(Bus&&) noexcept;
    Bus& operator=(Bus&&) noexcept;
    ~Bus();

    /// [setup] `channel` may be a regular expression as in LCM. Messages above max_bytes are refused and counted.
    /// udpm://: at most `queue` messages wait undelivered; what comes on top is dropped (a gap in the sequence).
    Status subscribe(const std::string& channel, std::size_t max_bytes, Handler handler, int queue = 64);
    /// [loop] False if the message was refused: too large, a bad channel name, or memq:// full (4096 messages or 256
    /// MiB wait undelivered): dispatch, then try again.
    bool publish(std::string_view channel, std::span<const std::uint8_t> data) noexcept;
    /// [loop] Delivers what has arrived, waiting at most timeout_ms for the first; returns the number delivered,
    /// at most 1024 (handlers may publish); -1 at the end of a file:// log or when the provider failed.
    int dispatch(int timeout_ms) noexcept;

    const BusCounters& counters() const;
    const std::string& url() const;

  private:
    struct Impl;
    explicit Bus(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace teres
