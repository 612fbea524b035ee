#include "core/log_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <lcm/lcm.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "core/bus.h"

namespace teres {
namespace {

constexpr std::uint32_t kSyncWord = 0xEDA1DA01;
constexpr std::size_t kHeaderBytes = 28;
constexpr std::size_t kWindowBytes = 1 << 20;

std::uint64_t big_endian(const std::uint8_t* bytes, int count) {
    std::uint64_t value = 0;
    for (int i = 0; i < count; ++i) value = value << 8 | bytes[i];
    return value;
}

}  // namespace

struct LogReader::Header {
    std::int64_t number, stamp_us, channel_bytes, data_bytes;
    std::int64_t event_bytes() const { return static_cast<std::int64_t>(kHeaderBytes) + channel_bytes + data_bytes; }
};

Result<LogReader> LogReader::open(const std::filesystem::path& file) {
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return invalid_input("log " + file.string() + ": " + std::strerror(errno));
    struct stat info {};
    if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        close(fd);
        return invalid_input("log " + file.string() + ": not a regular file");
    }
    LogReader reader(fd, info.st_size, file.string());
    if (info.st_size == 0) return invalid_input("log " + file.string() + ": empty file, no event");
    return reader;
}

LogReader::LogReader(int fd, std::int64_t size, std::string name) : fd_(fd), size_(size), name_(std::move(name)) {}

LogReader::LogReader(LogReader&& other) noexcept {
    *this = std::move(other);
}

LogReader& LogReader::operator=(LogReader&& other) noexcept {
    std::swap(fd_, other.fd_);
    size_ = other.size_;
    position_ = other.position_;
    last_stamp_us_ = other.last_stamp_us_;
    name_ = std::move(other.name_);
    damage_ = other.damage_;
    window_ = std::move(other.window_);
    window_offset_ = other.window_offset_;
    return *this;
}

LogReader::~LogReader() {
    if (fd_ >= 0) close(fd_);
}

void LogReader::rewind() {
    position_ = 0;
    damage_ = {};
    last_stamp_us_ = std::numeric_limits<std::int64_t>::min();
}

// The bytes [offset, offset + count), empty if the file does not hold them all.
std::span<const std::uint8_t> LogReader::bytes(std::int64_t offset, std::size_t count) {
    if (offset < 0 || offset > size_ || static_cast<std::int64_t>(count) > size_ - offset) return {};
    const std::int64_t held = static_cast<std::int64_t>(window_.size());
    if (offset < window_offset_ || offset + static_cast<std::int64_t>(count) > window_offset_ + held) {
        const auto wanted =
            std::min<std::int64_t>(size_ - offset, static_cast<std::int64_t>(std::max(count, kWindowBytes)));
        window_.resize(static_cast<std::size_t>(wanted));
        window_offset_ = offset;
        std::size_t got = 0;
        while (got < window_.size()) {
            const ssize_t n = pread(fd_, window_.data() + got, window_.size() - got, offset + static_cast<off_t>(got));
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) break;  // the file shrank, or its disk fails: it ends here
            got += static_cast<std::size_t>(n);
        }
        if (got < window_.size()) {
            window_.resize(got);
            size_ = offset + static_cast<std::int64_t>(got);
            if (got < count) return {};
        }
    }
    return std::span<const std::uint8_t>(window_).subspan(static_cast<std::size_t>(offset - window_offset_), count);
}

// A sync word with lengths inside the bounds; whether the file holds the whole event is not asked here.
bool LogReader::read_header(std::int64_t offset, Header& header) {
    const auto raw = bytes(offset, kHeaderBytes);
    if (raw.empty() || big_endian(raw.data(), 4) != kSyncWord) return false;
    header.number = static_cast<std::int64_t>(big_endian(raw.data() + 4, 8));
    header.stamp_us = static_cast<std::int64_t>(big_endian(raw.data() + 12, 8));
    header.channel_bytes = static_cast<std::int32_t>(big_endian(raw.data() + 20, 4));
    header.data_bytes = static_cast<std::int32_t>(big_endian(raw.data() + 24, 4));
    return header.channel_bytes > 0 && header.channel_bytes <= LCM_MAX_CHANNEL_NAME_LENGTH && header.data_bytes >= 0 &&
           header.data_bytes <= static_cast<std::int64_t>(kMaxMessageBytes);
}

// Reads beside the window: a far look per event must not cost a window.
bool LogReader::sync_word_at(std::int64_t offset) const {
    std::uint8_t raw[4];
    return pread(fd_, raw, sizeof raw, offset) == 4 && big_endian(raw, 4) == kSyncWord;
}

// Offset of the first plausible event in [from, to), or -1.
std::int64_t LogReader::find_header(std::int64_t from, std::int64_t to, bool must_fit) {
    constexpr std::int64_t kStride = 1 << 16;
    for (std::int64_t at = from; at < to;) {
        const std::int64_t count = std::min(kStride, size_ - at);
        if (count < 4) return -1;
        const auto block = bytes(at, static_cast<std::size_t>(count));
        if (block.empty()) return -1;
        std::int64_t next = at + count - 3;  // a sync word may straddle two blocks
        for (std::int64_t i = 0; i + 4 <= count && at + i < to; ++i) {
            if (block[static_cast<std::size_t>(i)] != 0xED || big_endian(block.data() + i, 4) != kSyncWord) continue;
            Header header{};
            if (read_header(at + i, header) && (!must_fit || header.event_bytes() <= size_ - (at + i))) return at + i;
            next = at + i + 1;  // read_header may have moved the window: take a new block
            break;
        }
        at = next;
    }
    return -1;
}

void LogReader::skip(std::int64_t from, std::int64_t to) {
    ++damage_.regions;
    damage_.skipped_bytes += to - from;
    if (damage_.first_offset < 0) damage_.first_offset = from;
    position_ = to;
}

bool LogReader::next(LogEvent& event) {
    while (position_ < size_) {
        const std::int64_t start = position_;
        Header header{};
        if (!read_header(start, header)) {
            // An end shorter than a header that begins with the sync word (or a part of it) is a cut event.
            const std::int64_t found = find_header(start, size_, false);
            if (found >= 0) {
                skip(start, found);
                continue;
            }
            const std::int64_t left = size_ - start;
            if (left < static_cast<std::int64_t>(kHeaderBytes))
                damage_.truncated_at = start;
            else
                skip(start, size_);
            position_ = size_;
            return false;
        }
        const std::int64_t end = start + header.event_bytes();
        if (end > size_) {
            const std::int64_t found = find_header(start + 4, size_, true);
            if (found >= 0) {
                skip(start, found);
                continue;
            }
            damage_.truncated_at = start;
            position_ = size_;
            return false;
        }
        // A length that is wrong but possible swallows the events that follow: where no sync word follows, an
        // event inside this one is believed instead.
        if (end < size_ && !sync_word_at(end)) {
            const std::int64_t found = find_header(start + 4, end, true);
            if (found >= 0) {
                skip(start, found);
                continue;
            }
        }
        const auto payload = bytes(start + static_cast<std::int64_t>(kHeaderBytes),
                                   static_cast<std::size_t>(header.channel_bytes + header.data_bytes));
        if (payload.empty()) {  // the file shrank under us
            damage_.truncated_at = start;
            position_ = size_;
            return false;
        }
        position_ = end;
        if (header.stamp_us < last_stamp_us_) ++damage_.backward_stamps;
        last_stamp_us_ = header.stamp_us;
        event.number = header.number;
        event.stamp_us = header.stamp_us;
        event.offset = start;
        event.channel = {reinterpret_cast<const char*>(payload.data()), static_cast<std::size_t>(header.channel_bytes)};
        event.data = payload.subspan(static_cast<std::size_t>(header.channel_bytes));
        return true;
    }
    return false;
}

std::string LogReader::damage_text() const {
    if (damage_.none()) return {};
    std::string text;
    if (damage_.truncated_at >= 0)
        text += fmt::format("; cut off at byte {} of {}, read up to there", damage_.truncated_at, size_);
    if (damage_.regions > 0)
        text += fmt::format("; {} damaged bytes skipped in {} places, the first at byte {}", damage_.skipped_bytes,
                            damage_.regions, damage_.first_offset);
    if (damage_.backward_stamps > 0) text += fmt::format("; time goes backwards {} times", damage_.backward_stamps);
    return fmt::format("log {}:{}", name_, text.substr(1));
}

}  // namespace teres
