// What a message says, for people: its type by hash and the fields of the types in core/messages.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

namespace teres::tools {

struct MessageFields {
    std::string type;  ///< "teres.markers_t", or "0x..." (the hash) if not one of ours; empty if too short for a hash
    nlohmann::json values;  ///< object; arrays are cut to their first elements, counts stand beside them;
                            ///< null if malformed
};

/// Never throws on hostile bytes: what cannot be decoded has null values.
MessageFields message_fields(std::span<const std::uint8_t> data);

/// "num_markers=26 lost=1 x_m=[0.1 0.2 ...]": one line without control characters, whatever the strings hold.
std::string one_line(const nlohmann::json& values);
/// The text with everything but printable ASCII replaced by '?'.
std::string printable(std::string_view text);

}  // namespace teres::tools
