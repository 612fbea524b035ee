// A CSV table with a fixed header: comma-separated, no quotes, one line per row.
//
// Every value is checked while reading; an error text names file, line, column, value and bound.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace teres {

enum class CsvKind {
    kNumber,       ///< finite
    kNumberOrNan,  ///< finite or NaN (a lost marker)
    kId,           ///< integer in [0, 2^31)
    kText,         ///< not empty
};

struct CsvColumn {
    std::string name;
    CsvKind kind = CsvKind::kNumber;
};

class CsvTable {
  public:
    /// `name` stands in the error texts. The header must name exactly `columns`, in this order.
    /// The last line must end with a line end: without one a file cut inside its last number would pass.
    static Result<CsvTable> parse(std::string_view text, std::string name, std::span<const CsvColumn> columns);
    static Result<CsvTable> read(const std::filesystem::path& file, std::span<const CsvColumn> columns);

    std::size_t num_rows() const { return lines_.size(); }
    double number(std::size_t row, std::size_t column) const { return values_[row * columns_.size() + column]; }
    std::int32_t id(std::size_t row, std::size_t column) const {
        return static_cast<std::int32_t>(number(row, column));
    }
    const std::string& text(std::size_t row, std::size_t column) const {
        return texts_[static_cast<std::size_t>(number(row, column))];
    }
    const std::string& name() const { return name_; }
    /// "loads.csv:17", the place of a row.
    std::string place(std::size_t row) const { return name_ + ":" + std::to_string(lines_[row]); }

  private:
    std::string name_;
    std::vector<CsvColumn> columns_;
    std::vector<double> values_;  // row-major; a text column holds an index into texts_
    std::vector<std::string> texts_;
    std::vector<std::size_t> lines_;  // line of each row, from 1
};

}  // namespace teres
