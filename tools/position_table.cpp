#include "tools/position_table.h"

#include <cstdio>

#include "core/case/text_writer.h"

namespace teres::tools {

void PositionTable::add(double t_s, std::span<const std::int32_t> ids, std::span<const double> xyz_m) {
    char line[160];
    for (std::size_t k = 0; k < ids.size(); ++k) {
        std::snprintf(line, sizeof line, "%.6f,%d,%.7f,%.7f,%.7f\n", t_s, ids[k], xyz_m[3 * k], xyz_m[3 * k + 1],
                      xyz_m[3 * k + 2]);
        text_ += line;
    }
}

Status PositionTable::write(const std::filesystem::path& file) const {
    return write_text_file(file, text_);
}

}  // namespace teres::tools
