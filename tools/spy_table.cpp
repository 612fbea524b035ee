#include "tools/spy_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/message_stamp.h"
#include "tools/message_fields.h"

namespace teres::tools {
namespace {

constexpr const char* kOther = "(other)";

std::string bytes_text(double bytes) {
    if (bytes >= 1e6) return fmt::format("{:.2f} MB", bytes / 1e6);
    if (bytes >= 1e3) return fmt::format("{:.2f} kB", bytes / 1e3);
    return fmt::format("{:.0f} B", bytes);
}

std::string age_text(double age_s) {
    return age_s < 1.0 ? fmt::format("{:.0f} ms", 1e3 * age_s) : fmt::format("{:.1f} s", age_s);
}

}  // namespace

void SpyTable::add(std::string_view channel, std::span<const std::uint8_t> data, std::int64_t now_us) {
    ++messages_;
    auto entry = channels_.find(channel);
    if (entry == channels_.end())
        entry = channels_.try_emplace(channels_.size() < kMaxChannels ? std::string(channel) : kOther).first;
    Traffic& traffic = entry->second;
    traffic.arrivals[static_cast<std::size_t>(traffic.messages) % kRing] = {now_us, data.size()};
    ++traffic.messages;
    traffic.bytes += static_cast<std::int64_t>(data.size());
    if (const auto stamp = stamp_of(data); stamp && entry->first != kOther) {
        if (traffic.sequence && stamp->sequence <= *traffic.sequence)
            ++traffic.restarts;
        else if (traffic.sequence)  // difference of values from the network: unsigned, it may be anything
            traffic.lost += static_cast<std::int64_t>(std::min<std::uint64_t>(
                static_cast<std::uint64_t>(stamp->sequence) - static_cast<std::uint64_t>(*traffic.sequence) - 1,
                1u << 31));
        traffic.sequence = stamp->sequence;
    }
    const std::size_t kept = data.size() <= kMaxKept ? data.size() : 8;
    traffic.newest.assign(data.begin(), data.begin() + static_cast<std::ptrdiff_t>(kept));
}

SpyRow SpyTable::row(const std::string& channel, const Traffic& traffic, std::int64_t now_us) {
    SpyRow row;
    row.channel = printable(channel);
    row.messages = traffic.messages;
    row.bytes = traffic.bytes;
    row.lost = traffic.lost;
    row.restarts = traffic.restarts;
    const auto total = static_cast<std::size_t>(traffic.messages);
    const std::size_t count = std::min(total, kRing);
    const auto arrival = [&](std::size_t i) -> const Arrival& { return traffic.arrivals[(total - count + i) % kRing]; };
    const double newest_us = static_cast<double>(arrival(count - 1).at_us);
    row.age_s = std::max(0.0, (static_cast<double>(now_us) - newest_us) * 1e-6);
    if (count > 1) {
        const double span_s = (newest_us - static_cast<double>(arrival(0).at_us)) * 1e-6;
        const double mean_s = span_s / static_cast<double>(count - 1);
        // Silent for longer than an interval: the silence counts as the interval that is under way.
        const double seen_s = span_s + std::max(0.0, row.age_s - mean_s);
        double bytes = 0.0, squares = 0.0;
        for (std::size_t i = 1; i < count; ++i) {
            bytes += static_cast<double>(arrival(i).bytes);
            const double deviation_s = static_cast<double>(arrival(i).at_us - arrival(i - 1).at_us) * 1e-6 - mean_s;
            squares += deviation_s * deviation_s;
        }
        if (seen_s > 0.0) {
            row.rate_hz = static_cast<double>(count - 1) / seen_s;
            row.bytes_per_s = bytes / seen_s;
        }
        row.jitter_ms = 1e3 * std::sqrt(squares / static_cast<double>(count - 1));
    }
    MessageFields fields = message_fields(traffic.newest);
    row.type = std::move(fields.type);
    row.fields = std::move(fields.values);
    return row;
}

std::vector<SpyRow> SpyTable::rows(std::int64_t now_us) const {
    std::vector<SpyRow> rows;
    for (const auto& [channel, traffic] : channels_) rows.push_back(row(channel, traffic, now_us));
    return rows;
}

std::string as_text(const std::vector<SpyRow>& rows, std::size_t columns) {
    std::string text;
    const auto line = [&](std::string content) {
        if (content.size() > columns) content = content.substr(0, columns > 3 ? columns - 3 : 0) + "...";
        text += content + "\n";
    };
    line(fmt::format("{:<18} {:>9} {:>9} {:>11} {:>9} {:>6} {:>9}  {}", "channel", "messages", "Hz", "bytes/s",
                     "jitter", "lost", "age", "type"));
    for (const SpyRow& row : rows) {
        line(fmt::format("{:<18} {:>9} {:>9.2f} {:>11} {:>6.2f} ms {:>6} {:>9}  {}", row.channel, row.messages,
                         row.rate_hz, bytes_text(row.bytes_per_s), row.jitter_ms, row.lost, age_text(row.age_s),
                         row.type));
        if (!row.fields.is_null()) line("    " + one_line(row.fields));
    }
    return text;
}

std::string as_json(const std::vector<SpyRow>& rows) {
    nlohmann::json channels = nlohmann::json::array();
    for (const SpyRow& row : rows)
        channels.push_back({{"channel", row.channel},
                            {"messages", row.messages},
                            {"bytes", row.bytes},
                            {"rate_hz", row.rate_hz},
                            {"bytes_per_s", row.bytes_per_s},
                            {"jitter_ms", row.jitter_ms},
                            {"age_s", row.age_s},
                            {"lost", row.lost},
                            {"restarts", row.restarts},
                            {"type", row.type},
                            {"fields", row.fields}});
    // Strings come from the network and need not be UTF-8.
    return nlohmann::json{{"channels", channels}}.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace teres::tools
