// Any bytes as a table: an error that names the file, or rows whose values keep what their columns promise.
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/case/csv_table.h"
#include "core/check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using teres::CsvKind;
    static const std::vector<teres::CsvColumn> columns{{"t_s", CsvKind::kNumber},
                                                       {"region", CsvKind::kText},
                                                       {"node_id", CsvKind::kId},
                                                       {"x_m", CsvKind::kNumberOrNan}};
    const auto table = teres::CsvTable::parse({reinterpret_cast<const char*>(data), size}, "table.csv", columns);
    if (!table) {
        TERES_CHECK(table.error().text.rfind("table.csv:", 0) == 0);
        return 0;
    }
    for (std::size_t row = 0; row < table->num_rows(); ++row) {
        TERES_CHECK(std::isfinite(table->number(row, 0)));
        TERES_CHECK(!table->text(row, 1).empty());
        TERES_CHECK(table->id(row, 2) >= 0);
        TERES_CHECK(!std::isinf(table->number(row, 3)));
    }
    return 0;
}
