#include "tools/phantom/respiration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/case/csv_table.h"
#include "core/case/geometry.h"
#include "core/case/text_file.h"

namespace teres::phantom {
namespace {

constexpr double kMaxGap_s = 1.0;  // a breath lasts some 4 s
constexpr double kLeastRange_mm = 0.1, kLargestRange_mm = 200.0;

// The columns are those that the header names.
Result<std::vector<CsvColumn>> columns_of(const std::filesystem::path& file, std::string_view text) {
    std::vector<CsvColumn> columns;
    text = without_byte_order_mark(text);
    const std::string header(text.substr(0, text.find_first_of("\r\n")));
    std::stringstream words(header);
    for (std::string name; std::getline(words, name, ',');) columns.push_back({name});
    if (columns.size() < 2 || columns.front().name != "t_s")
        return invalid_input(fmt::format("{}:1: header {}, expected t_s and columns of positions in mm", file.string(),
                                         in_quotes(header)));
    return columns;
}

double range(const CsvTable& table, std::size_t column) {
    double low = table.number(0, column), high = low;
    for (std::size_t row = 1; row < table.num_rows(); ++row) {
        low = std::min(low, table.number(row, column));
        high = std::max(high, table.number(row, column));
    }
    return high - low;
}

Status check_times(const CsvTable& table, double seconds) {
    for (std::size_t row = 1; row < table.num_rows(); ++row) {
        const double step = table.number(row, 0) - table.number(row - 1, 0);
        if (step > 0.0 && step <= kMaxGap_s) continue;
        return invalid_input(
            fmt::format("{}: t_s = {}, {} s after the line before it; steps must lie above 0 and not above {} s",
                        table.place(row), table.number(row, 0), step, kMaxGap_s));
    }
    const double length = table.number(table.num_rows() - 1, 0) - table.number(0, 0);
    if (seconds > length + 1e-9)
        return invalid_input(fmt::format("{}: {} s of breathing, too short for a film of {} s; it is not repeated",
                                         table.name(), length, seconds));
    return {};
}

}  // namespace

Result<Respiration> Respiration::read(const RespirationOptions& options, double seconds) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(options.file));
    TERES_TRY_ASSIGN(const auto columns, columns_of(options.file, text));
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::parse(text, options.file.string(), columns));
    if (table.num_rows() < 2) return invalid_input(table.name() + ": fewer than two samples");
    TERES_TRY(check_times(table, seconds));

    std::size_t chosen = 1;
    for (std::size_t k = 2; k < columns.size(); ++k)
        if (range(table, k) > range(table, chosen)) chosen = k;
    if (!options.column.empty()) {
        const auto named = std::find_if(columns.begin() + 1, columns.end(),
                                        [&](const CsvColumn& c) { return c.name == options.column; });
        if (named == columns.end())
            return invalid_input(fmt::format("{}:1: no column {} beside t_s", table.name(), in_quotes(options.column)));
        chosen = static_cast<std::size_t>(named - columns.begin());
    }
    const double recorded_mm = range(table, chosen);
    if (!(recorded_mm >= kLeastRange_mm && recorded_mm <= kLargestRange_mm))
        return invalid_input(fmt::format("{}: {} ranges over {} mm, expected {} to {} mm; is it in mm?", table.name(),
                                         columns[chosen].name, recorded_mm, kLeastRange_mm, kLargestRange_mm));
    const double length = norm(options.direction);
    if (!(length > 0.0)) return invalid_input("respiration: the direction has no length");

    Respiration out;
    out.column_ = columns[chosen].name;
    out.range_m_ = 1e-3 * (options.amplitude_mm > 0.0 ? options.amplitude_mm : recorded_mm);
    const double m_per_mm = out.range_m_ / recorded_mm;
    for (std::size_t row = 0; row < table.num_rows(); ++row) {
        out.times_.push_back(table.number(row, 0) - table.number(0, 0));
        out.shifts_.push_back(
            times(m_per_mm * (table.number(row, chosen) - table.number(0, chosen)) / length, options.direction));
    }
    return out;
}

Point Respiration::at(double t_s) const {
    const auto after = std::upper_bound(times_.begin(), times_.end(), t_s);
    const auto k =
        static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(after - times_.begin(), 1, std::ssize(times_) - 1));
    const double w = std::clamp((t_s - times_[k - 1]) / (times_[k] - times_[k - 1]), 0.0, 1.0);
    return plus(times(1.0 - w, shifts_[k - 1]), times(w, shifts_[k]));
}

}  // namespace teres::phantom
