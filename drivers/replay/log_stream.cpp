#include "drivers/replay/log_stream.h"

#include <algorithm>

#include "core/message_stamp.h"
#include "drivers/replay/case_stream.h"

namespace teres {
namespace {

constexpr int kLookAhead = 1000;  // events read to find the first capture stamp and whether the log has loads

// Times come from a file and may be anything: sums wrap instead of being undefined.
std::int64_t sum(std::int64_t a, std::int64_t b) {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) + static_cast<std::uint64_t>(b));
}

std::int64_t difference(std::int64_t a, std::int64_t b) {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b));
}

void put_big_endian(std::int64_t value, std::uint8_t* to) {
    for (int i = 0; i < 8; ++i) to[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (56 - 8 * i));
}

}  // namespace

void LogStream::Span::add(std::int64_t value) {
    first = values == 0 ? value : std::min(first, value);
    if (values == 0 || value > last) last = value, ++values;
}

std::int64_t LogStream::Span::period() const {
    const std::int64_t span = difference(last, first);
    return std::max<std::int64_t>(1, sum(span, values > 1 ? span / (values - 1) : 1));
}

Result<std::unique_ptr<LogStream>> LogStream::open(const Options& options) {
    TERES_TRY_ASSIGN(LogReader reader, LogReader::open(options.file));
    TERES_TRY_ASSIGN(ChannelPattern channels, ChannelPattern::make(options.channels));
    std::unique_ptr<LogStream> stream(new LogStream(std::move(reader), std::move(channels)));
    if (!options.skip_channels.empty()) {
        TERES_TRY_ASSIGN(stream->skip_, ChannelPattern::make(options.skip_channels));
    }
    Packet first;
    if (!stream->read(first))
        return invalid_input("log " + options.file.string() + ": no event on the channels '" + options.channels +
                             (options.skip_channels.empty() ? "'" : "' without '" + options.skip_channels + "'") +
                             (stream->damage_text().empty() ? "" : "; " + stream->damage_text()));
    stream->look_ahead(options);
    return stream;
}

void LogStream::look_ahead(const Options& options) {
    reader_.rewind();
    bool stamped = false, has_loads = false;
    Packet packet;
    for (int i = 0; i < kLookAhead && read(packet); ++i) {
        if (!stamped && packet.capture_us) {
            start_us_ = *packet.capture_us;
            stamped = true;
        }
        has_loads = has_loads || packet.channel == kToolLoadsChannel;
    }
    if (!has_loads && options.loads != nullptr) {
        LoadTracks tracks(*options.loads);
        if (!tracks.empty()) loads_ = std::move(tracks);
        frame_id_ = options.loads->name;
    }
    reader_.rewind();
    stamps_ = captures_ = {};
    sequences_.clear();
}

bool LogStream::chosen(const std::string& channel) const {
    return channels_.matches(channel.c_str()) && !(skip_ && skip_->matches(channel.c_str()));
}

bool LogStream::read(Packet& packet) {
    LogEvent event;
    while (reader_.next(event)) {
        packet.channel = event.channel;
        if (!chosen(packet.channel)) continue;
        packet.data.assign(event.data.begin(), event.data.end());
        packet.stamp_us = event.stamp_us;
        stamps_.add(event.stamp_us);
        packet.capture_us.reset();
        if (const auto stamp = stamp_of(packet.data)) {
            packet.capture_us = stamp->capture_us;
            captures_.add(stamp->capture_us);
            sequences_[packet.channel].add(stamp->sequence);
        }
        return true;
    }
    return false;
}

// From the second pass on: times and sequence numbers go on instead of jumping back.
void LogStream::restamp(Packet& packet) {
    if (stamp_offset_us_ == 0) return;
    packet.stamp_us = sum(packet.stamp_us, stamp_offset_us_);
    const auto stamp = stamp_of(packet.data);
    if (!stamp) return;
    packet.capture_us = sum(stamp->capture_us, capture_offset_us_);
    put_big_endian(*packet.capture_us, packet.data.data() + 8);
    put_big_endian(sum(stamp->sequence, sequence_offset_[packet.channel]), packet.data.data() + 16);
}

bool LogStream::next(Packet& packet) {
    if (holding_) {
        std::swap(packet, held_);
        holding_ = false;
        return true;
    }
    if (!read(packet)) return false;
    const std::optional<std::int64_t> recorded_us = packet.capture_us;
    restamp(packet);
    if (!loads_ || !recorded_us || packet.channel != kMarkersChannel) return true;
    tool_loads_t loads;
    loads.header.capture_stamp_us = *packet.capture_us;
    loads.header.sequence = stamp_of(packet.data)->sequence;
    loads.header.frame_id = frame_id_;
    loads_->at(1e-6 * static_cast<double>(*recorded_us), loads);
    std::swap(packet, held_);
    holding_ = true;
    encode(loads, kToolLoadsChannel, packet);
    packet.stamp_us = held_.stamp_us;
    return true;
}

void LogStream::loop() {
    stamp_offset_us_ = sum(stamp_offset_us_, stamps_.period());
    if (captures_.values > 0) capture_offset_us_ = sum(capture_offset_us_, captures_.period());
    for (const auto& [channel, span] : sequences_)
        sequence_offset_[channel] = sum(sequence_offset_[channel], sum(difference(span.last, span.first), 1));
    stamps_ = captures_ = {};
    sequences_.clear();
    reader_.rewind();
}

}  // namespace teres
