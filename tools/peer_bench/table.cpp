#include "tools/peer_bench/table.h"

#include <algorithm>
#include <cmath>

#include "core/case/text_file.h"

namespace teres::peer {

Result<Table> Table::read(const std::filesystem::path& file, const std::vector<std::string>& texts) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    Table table;
    table.name_ = file.string();
    TextCursor cursor(without_byte_order_mark(text));
    const auto header = cursor.next_line();
    if (!header) return invalid_input(table.name_ + ":1: no header");
    std::string_view rest = *header;
    std::vector<CsvColumn> columns;
    for (bool more = true; more;) {
        const auto comma = rest.find(',');
        more = comma != std::string_view::npos;
        std::string name(rest.substr(0, comma));
        if (more) rest.remove_prefix(comma + 1);
        if (std::find(table.columns_.begin(), table.columns_.end(), name) != table.columns_.end())
            return invalid_input(table.name_ + ":1: column " + in_quotes(name) + " stands twice");
        const bool is_text = std::find(texts.begin(), texts.end(), name) != texts.end();
        columns.push_back({name, is_text ? CsvKind::kText : CsvKind::kNumber});
        table.columns_.push_back(std::move(name));
    }
    TERES_TRY_ASSIGN(table.table_, CsvTable::parse(text, table.name_, columns));
    return table;
}

std::optional<std::size_t> Table::find(const std::string& column) const {
    const auto at = std::find(columns_.begin(), columns_.end(), column);
    if (at == columns_.end()) return std::nullopt;
    return static_cast<std::size_t>(at - columns_.begin());
}

Result<std::size_t> Table::column(const std::vector<std::string>& synonyms) const {
    for (const auto& name : synonyms)
        if (const auto at = find(name)) return *at;
    return invalid_input(name_ + ":1: no column " + in_quotes(synonyms.front()));
}

Result<std::int32_t> Table::index(std::size_t row, std::size_t column, std::size_t below) const {
    const double value = number(row, column);
    if (value != std::floor(value) || value < 0.0 || value >= static_cast<double>(below))
        return invalid_input(place(row) + ": " + columns_[column] + " " + to_text(value) +
                             " is not an integer in [0, " + std::to_string(below) + ")");
    return static_cast<std::int32_t>(value);
}

}  // namespace teres::peer
