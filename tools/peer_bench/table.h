// A CSV file whose header is not known beforehand (the peer's folders): columns by name.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/case/csv_table.h"
#include "core/result.h"

namespace teres::peer {

class Table {
  public:
    /// Columns named in `texts` are read as text, all others as finite numbers.
    static Result<Table> read(const std::filesystem::path& file, const std::vector<std::string>& texts = {});

    std::size_t num_rows() const { return table_->num_rows(); }
    const std::vector<std::string>& columns() const { return columns_; }
    std::optional<std::size_t> find(const std::string& column) const;
    /// Index of the first of the synonyms present.
    Result<std::size_t> column(const std::vector<std::string>& synonyms) const;
    double number(std::size_t row, std::size_t column) const { return table_->number(row, column); }
    const std::string& text(std::size_t row, std::size_t column) const { return table_->text(row, column); }
    /// Error unless the value is an integer in [0, below).
    Result<std::int32_t> index(std::size_t row, std::size_t column, std::size_t below) const;
    std::string place(std::size_t row) const { return table_->place(row); }
    const std::string& name() const { return name_; }

  private:
    std::string name_;
    std::vector<std::string> columns_;
    std::optional<CsvTable> table_;
};

}  // namespace teres::peer
