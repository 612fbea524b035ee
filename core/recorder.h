// Writes an LCM event log that lcm-logger, lcm-logplayer and core/log_reader.h understand, without holding up
// the loop: messages go through a bounded queue to a writer thread, which flushes them to the kernel at once
// and to the disk once a second. A full disk stops the recording, not the service.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "core/result.h"

namespace teres {

struct RecorderSettings {
    std::filesystem::path file;
    std::int64_t split_mb = 0;  ///< > 0: files file.00, file.01, ... of about this size (as lcm-logger --split-mb)
    int keep = 0;               ///< > 0 with split_mb: only the newest `keep` files stay
    std::int64_t max_mb = 0;    ///< > 0: recording stops when this much has been written
    std::size_t queue_bytes = 64 << 20;  ///< what may wait for the writer; more is dropped and counted
    bool overwrite = false;              ///< an existing file is an error otherwise
};

struct RecorderCounters {
    std::int64_t written = 0;        ///< messages in the log
    std::int64_t written_bytes = 0;  ///< size of the log, all files
    std::int64_t dropped = 0;        ///< queue full, message too large, or after the recording stopped
    bool stopped = false;            ///< disk full, write error or max_mb reached
};

class Recorder {
  public:
    /// [setup] Errors: kInvalidInput if the file exists or a bound is broken, kHostFault if it cannot be
    /// created.
    static Result<Recorder> open(const RecorderSettings& settings);
    Recorder(Recorder&&) noexcept;
    Recorder& operator=(Recorder&&) noexcept;
    /// Writes what waits in the queue and closes the log.
    ~Recorder();

    /// [loop] One thread. `stamp_us`: microseconds since the epoch (wall_clock_us for a live recording).
    /// False if dropped.
    bool record(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t stamp_us) noexcept;
    /// [loop] Any thread.
    RecorderCounters counters() const;
    /// Why the recording stopped; empty while it runs. [setup]
    std::string stop_reason() const;
    /// [setup] Waits until everything recorded so far is in the file.
    void flush();

    /// Microseconds since the epoch that never run backwards: the wall clock at the first call plus the
    /// monotonic clock.
    static std::int64_t wall_clock_us();

  private:
    struct Impl;
    explicit Recorder(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace teres
