#include "core/case/text_file.h"

#include <charconv>
#include <cstdio>
#include <fstream>
#include <system_error>

namespace teres {
namespace {

bool is_space(char c) {
    return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v';
}

template <class T>
std::optional<T> parse_whole(std::string_view word) {
    if (word.size() > 1 && word.front() == '+' && word[1] != '-') word.remove_prefix(1);
    T value{};
    const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (code != std::errc() || end != word.data() + word.size()) return std::nullopt;
    return value;
}

}  // namespace

Result<std::string> read_text_file(const std::filesystem::path& file) {
    std::error_code code;
    const std::filesystem::file_status status = std::filesystem::status(file, code);
    if (status.type() == std::filesystem::file_type::not_found)
        return invalid_input(file.string() + ": file not found");
    if (status.type() != std::filesystem::file_type::regular)
        return invalid_input(file.string() + ": not a regular file" + (code ? " (" + code.message() + ")" : ""));
    const std::uintmax_t size = std::filesystem::file_size(file, code);
    if (code) return invalid_input(file.string() + ": " + code.message());
    if (size > kMaxTextFileBytes)
        return invalid_input(file.string() + ": " + std::to_string(size) + " bytes, at most " +
                             std::to_string(kMaxTextFileBytes) + " are read");
    std::ifstream stream(file, std::ios::binary);
    std::string text(static_cast<std::size_t>(size), '\0');
    if (!stream || !stream.read(text.data(), static_cast<std::streamsize>(size)))
        return invalid_input(file.string() + ": cannot be read");
    return text;
}

std::string_view without_byte_order_mark(std::string_view text) {
    if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
    return text;
}

std::optional<double> parse_number(std::string_view word) {
    return parse_whole<double>(word);
}

std::optional<std::int64_t> parse_integer(std::string_view word) {
    return parse_whole<std::int64_t>(word);
}

std::string to_text(double value) {
    char buffer[40];
    std::snprintf(buffer, sizeof buffer, "%.9g", value);
    return buffer;
}

std::string in_quotes(std::string_view word) {
    constexpr std::size_t kLongest = 40;
    std::string out = "'";
    for (const char c : word.substr(0, kLongest)) out += (c >= ' ' && c != '\x7F') ? c : '?';
    return out + (word.size() > kLongest ? "...'" : "'");
}

std::optional<std::string_view> TextCursor::next_line() {
    if (position_ >= text_.size()) return std::nullopt;
    line_ = next_line_;
    const std::size_t end = text_.find('\n', position_);
    std::string_view line = text_.substr(position_, end == std::string_view::npos ? end : end - position_);
    position_ = end == std::string_view::npos ? text_.size() : end + 1;
    if (end != std::string_view::npos) ++next_line_;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return line;
}

std::optional<std::string_view> TextCursor::next_word() {
    while (position_ < text_.size() && is_space(text_[position_])) {
        if (text_[position_] == '\n') ++next_line_;
        ++position_;
    }
    line_ = next_line_;
    if (position_ >= text_.size()) return std::nullopt;
    const std::size_t begin = position_;
    while (position_ < text_.size() && !is_space(text_[position_])) ++position_;
    return text_.substr(begin, position_ - begin);
}

}  // namespace teres
