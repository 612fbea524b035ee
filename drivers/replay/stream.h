// What the replay driver plays: a sequence of packets, one channel and its bytes each, in the order of the
// recording.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace teres {

struct Packet {
    std::string channel;
    std::vector<std::uint8_t> data;
    std::int64_t stamp_us = 0;               ///< paces the stream: capture (case) or reception (log)
    std::optional<std::int64_t> capture_us;  ///< of a message of ours
};

class Stream {
  public:
    virtual ~Stream() = default;
    /// [loop] The next packet into `packet` (its memory is reused); false at the end.
    virtual bool next(Packet& packet) = 0;
    /// [loop] Starts over. Stamps go on where they ended (one median frame later) and sequence numbers count
    /// on.
    virtual void loop() = 0;
    /// Capture stamp of the first message [us].
    virtual std::int64_t start_us() const = 0;
    /// What is wrong with the recording as far as it was read, in one sentence; empty if nothing.
    virtual std::string damage_text() const { return {}; }
};

/// Writes an LCM message into the packet.
template <class Message>
void encode(const Message& message, const char* channel, Packet& packet) {
    packet.channel = channel;
    packet.data.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(packet.data.data(), 0, static_cast<int>(packet.data.size()));
    packet.capture_us = message.header.capture_stamp_us;
    packet.stamp_us = message.header.capture_stamp_us;
}

}  // namespace teres
