// Predicted positions as a table: t_s,point_id,x_m,y_m,z_m.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "core/result.h"

namespace teres::tools {

class PositionTable {
  public:
    explicit PositionTable(const std::string& id_column = "point_id") : text_("t_s," + id_column + ",x_m,y_m,z_m\n") {}
    /// xyz: 3 per id.
    void add(double t_s, std::span<const std::int32_t> ids, std::span<const double> xyz_m);
    Status write(const std::filesystem::path& file) const;

  private:
    std::string text_;
};

}  // namespace teres::tools
