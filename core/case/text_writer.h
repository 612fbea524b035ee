// Lines of separated values, numbers in the shortest text that reads back to the same bits; NaN as "NaN".
#pragma once

#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "core/result.h"

namespace teres {

class TextWriter {
  public:
    explicit TextWriter(char separator = ',') : separator_(separator) {}

    /// One line: numbers, texts and arrays of numbers.
    template <class... Values>
    void line(const Values&... values) {
        const std::size_t begin = text_.size();
        (add(values, begin), ...);
        text_ += '\n';
    }
    const std::string& text() const { return text_; }

  private:
    void separate(std::size_t begin) {
        if (text_.size() > begin) text_ += separator_;
    }
    void add(std::string_view value, std::size_t begin) {
        separate(begin);
        text_ += value;
    }
    template <class Number>
    requires std::integral<Number> || std::floating_point<Number>
    void add(Number value, std::size_t begin) {
        separate(begin);
        if constexpr (std::floating_point<Number>) {
            if (std::isnan(value)) {
                text_ += "NaN";
                return;
            }
        }
        std::array<char, 32> buffer{};
        const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
        text_.append(buffer.data(), end);
    }
    template <class Number, std::size_t N>
    void add(const std::array<Number, N>& values, std::size_t begin) {
        for (const Number value : values) add(value, begin);
    }

    std::string text_;
    char separator_;
};

/// Writes `text` beside the file and renames it, so that a reader never sees half a file. Errors: kHostFault.
Status write_text_file(const std::filesystem::path& file, std::string_view text);

}  // namespace teres
