#include "core/case/csv_table.h"

#include <cmath>
#include <limits>

#include "core/case/text_file.h"

namespace teres {
namespace {

std::string_view trimmed(std::string_view word) {
    while (!word.empty() && (word.front() == ' ' || word.front() == '\t')) word.remove_prefix(1);
    while (!word.empty() && (word.back() == ' ' || word.back() == '\t')) word.remove_suffix(1);
    return word;
}

// Fields of one line; returns how many there are, also beyond the size of `fields`.
std::size_t split(std::string_view line, std::vector<std::string_view>& fields) {
    fields.clear();
    while (true) {
        const std::size_t comma = line.find(',');
        fields.push_back(trimmed(line.substr(0, comma)));
        if (comma == std::string_view::npos) return fields.size();
        line.remove_prefix(comma + 1);
    }
}

std::string header_text(std::span<const CsvColumn> columns) {
    std::string out;
    for (const CsvColumn& column : columns) out += (out.empty() ? "" : ",") + column.name;
    return out;
}

}  // namespace

Result<CsvTable> CsvTable::parse(std::string_view text, std::string name, std::span<const CsvColumn> columns) {
    CsvTable table;
    table.name_ = std::move(name);
    table.columns_.assign(columns.begin(), columns.end());
    text = without_byte_order_mark(text);
    TextCursor cursor(text);
    const auto here = [&] { return table.name_ + ":" + std::to_string(cursor.line()) + ": "; };

    std::vector<std::string_view> fields;
    const auto header = cursor.next_line();
    if (!header)
        return invalid_input(table.name_ + ":1: empty file, expected the header " + in_quotes(header_text(columns)));
    split(*header, fields);
    for (std::size_t i = 0; i < std::max(fields.size(), columns.size()); ++i) {
        if (i < fields.size() && i < columns.size() && fields[i] == columns[i].name) continue;
        return invalid_input(here() + "header " + in_quotes(*header) + ", expected '" + header_text(columns) + "'");
    }

    while (const auto line = cursor.next_line()) {
        if (trimmed(*line).empty()) continue;
        if (split(*line, fields) != columns.size())
            return invalid_input(here() + std::to_string(fields.size()) + " columns, expected " +
                                 std::to_string(columns.size()) + " (" + header_text(columns) + ")" +
                                 (cursor.bytes_left() == 0 ? "; is the file truncated?" : ""));
        table.lines_.push_back(cursor.line());
        for (std::size_t i = 0; i < columns.size(); ++i) {
            const CsvColumn& column = columns[i];
            const std::string_view field = fields[i];
            const auto wrong = [&](const char* expected) {
                return invalid_input(here() + column.name + " = " + in_quotes(field) + ", expected " + expected);
            };
            if (column.kind == CsvKind::kText) {
                if (field.empty()) return wrong("a name");
                table.values_.push_back(static_cast<double>(table.texts_.size()));
                table.texts_.emplace_back(field);
            } else if (column.kind == CsvKind::kId) {
                const auto id = parse_integer(field);
                if (!id || *id < 0 || *id > std::numeric_limits<std::int32_t>::max())
                    return wrong("an integer in [0, 2147483647]");
                table.values_.push_back(static_cast<double>(*id));
            } else {
                const auto number = parse_number(field);
                const bool nan_allowed = column.kind == CsvKind::kNumberOrNan;
                if (!number || !(std::isfinite(*number) || (nan_allowed && std::isnan(*number))))
                    return wrong(nan_allowed ? "a finite number or NaN" : "a finite number");
                table.values_.push_back(*number);
            }
        }
    }
    if (text.back() != '\n')
        return invalid_input(here() + "the last line has no line end: truncated? (add one if the file is complete)");
    return table;
}

Result<CsvTable> CsvTable::read(const std::filesystem::path& file, std::span<const CsvColumn> columns) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    return parse(text, file.string(), columns);
}

}  // namespace teres
