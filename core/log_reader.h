// Reads an LCM event log (lcm-logger, core/recorder.h) without trusting it.
//
//     event = sync word 0xEDA1DA01 · number i64 · stamp i64 [us] · channel length i32 · data length i32 ·
//     channel · data
//
// all big-endian. Lengths are checked against bounds and against the bytes that are left in the file before
// anything is allocated. Damage is skipped up to the next sync word that heads a plausible event; a cut end
// is reported with its offset.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace teres {

struct LogEvent {
    std::int64_t number = 0;
    std::int64_t stamp_us = 0;  ///< since the epoch, as the recorder received it
    std::int64_t offset = 0;    ///< of the sync word in the file [bytes]
    std::string_view channel;   ///< valid until the next call of next()
    std::span<const std::uint8_t> data;
};

/// What went wrong so far; all zero (and truncated_at negative) for a sound log.
struct LogDamage {
    std::int64_t regions = 0;  ///< damaged stretches that were skipped
    std::int64_t skipped_bytes = 0;
    std::int64_t first_offset = -1;    ///< of the first damaged stretch
    std::int64_t truncated_at = -1;    ///< offset of the event that the end of the file cuts
    std::int64_t backward_stamps = 0;  ///< events stamped before their predecessor
    bool none() const { return regions == 0 && truncated_at < 0 && backward_stamps == 0; }
};

class LogReader {
  public:
    /// [setup] Errors (kInvalidInput): not a regular file, unreadable, empty.
    static Result<LogReader> open(const std::filesystem::path& file);
    LogReader(LogReader&& other) noexcept;
    LogReader& operator=(LogReader&& other) noexcept;
    ~LogReader();

    /// The next sound event; false at the end of the log or when the file can no longer be read.
    bool next(LogEvent& event);
    /// Back to the first event; damage is counted anew.
    void rewind();

    const LogDamage& damage() const { return damage_; }
    /// One sentence that names the file and the byte offsets; empty for a sound log.
    std::string damage_text() const;
    std::int64_t size() const { return size_; }

  private:
    LogReader(int fd, std::int64_t size, std::string name);
    struct Header;
    std::span<const std::uint8_t> bytes(std::int64_t offset, std::size_t count);
    bool read_header(std::int64_t offset, Header& header);
    bool sync_word_at(std::int64_t offset) const;
    std::int64_t find_header(std::int64_t from, std::int64_t to, bool must_fit);
    void skip(std::int64_t from, std::int64_t to);

    int fd_ = -1;
    std::int64_t size_ = 0;
    std::int64_t position_ = 0;
    std::int64_t last_stamp_us_ = std::numeric_limits<std::int64_t>::min();
    std::string name_;
    LogDamage damage_;
    std::vector<std::uint8_t> window_;  // the stretch of the file from window_offset_ on
    std::int64_t window_offset_ = 0;
};

}  // namespace teres
