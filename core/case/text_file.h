// Text files read whole, numbers read without locale, lines counted for error texts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "core/result.h"

namespace teres {

/// Upper bound of a text file of a case [bytes]; an hour of 50 markers at 30 Hz is below it.
inline constexpr std::uintmax_t kMaxTextFileBytes = std::uintmax_t{1} << 29;

/// Reads a regular file. Errors (kInvalidInput): missing, not a file, above kMaxTextFileBytes, not readable.
Result<std::string> read_text_file(const std::filesystem::path& file);

/// The text without a UTF-8 byte order mark.
std::string_view without_byte_order_mark(std::string_view text);

/// The whole of `word` as a number ("nan" and "inf" included), whatever the locale.
std::optional<double> parse_number(std::string_view word);
std::optional<std::int64_t> parse_integer(std::string_view word);

/// Shortest of %.9g: a number as it stands in error texts.
std::string to_text(double value);
/// A word of a file as it may stand in an error text: printable, at most 40 characters, quoted.
std::string in_quotes(std::string_view word);

/// Walks over a text by lines or by words separated by white space. Knows Unix and Windows line ends.
class TextCursor {
  public:
    explicit TextCursor(std::string_view text) : text_(text) {}
    /// Rest of the line without its end; nullopt at the end of the text.
    std::optional<std::string_view> next_line();
    /// Next word; nullopt at the end of the text.
    std::optional<std::string_view> next_word();
    /// Line of the word or line read last, from 1.
    std::size_t line() const { return line_; }
    std::size_t bytes_left() const { return text_.size() - position_; }

  private:
    std::string_view text_;
    std::size_t position_ = 0;
    std::size_t line_ = 1;       // of what was read last
    std::size_t next_line_ = 1;  // of position_
};

}  // namespace teres
