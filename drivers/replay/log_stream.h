// An LCM event log as a stream: the chosen channels in their order, bytes untouched. Where the log has
// markers but no TOOL_LOADS, those of a case stand in: one message before each MARKERS, at its capture stamp.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/case/case.h"
#include "core/case/load_tracks.h"
#include "core/channel_pattern.h"
#include "core/log_reader.h"
#include "core/result.h"
#include "drivers/replay/stream.h"

namespace teres {

class LogStream final : public Stream {
  public:
    struct Options {
        std::filesystem::path file;
        std::string channels = ".*";  ///< played
        std::string skip_channels;    ///< of these, left out; empty: none
        const Case* loads = nullptr;  ///< stands in for missing TOOL_LOADS
    };
    /// [setup] Errors (kInvalidInput): unreadable log, a log without any event on the chosen channels.
    static Result<std::unique_ptr<LogStream>> open(const Options& options);

    bool next(Packet& packet) override;
    void loop() override;
    std::int64_t start_us() const override { return start_us_; }
    std::string damage_text() const override { return reader_.damage_text(); }

  private:
    LogStream(LogReader reader, ChannelPattern channels) : reader_(std::move(reader)), channels_(std::move(channels)) {}
    bool chosen(const std::string& channel) const;
    void look_ahead(const Options& options);
    bool read(Packet& packet);
    void restamp(Packet& packet);

    LogReader reader_;
    ChannelPattern channels_;
    std::optional<ChannelPattern> skip_;
    std::optional<LoadTracks> loads_;
    std::string frame_id_;  // of the loads
    Packet held_;           // the markers that wait behind their loads
    bool holding_ = false;
    std::int64_t start_us_ = 0;

    // For loop(): the span of times of one pass, and what the passes before add to stamps and sequence
    // numbers.
    struct Span {
        std::int64_t first = 0, last = 0, values = 0;
        void add(std::int64_t value);
        std::int64_t period() const;  // last - first and one mean step more
    };
    Span stamps_, captures_;
    std::map<std::string, Span, std::less<>> sequences_;
    std::map<std::string, std::int64_t, std::less<>> sequence_offset_;
    std::int64_t stamp_offset_us_ = 0, capture_offset_us_ = 0;
};

}  // namespace teres
