// A recorded breathing curve that carries the phantom: liver, cloth and frame are shifted together, nothing deforms.
//
//     d(t) = s [y(t) - y(0)] e        y: position of a skin marker, linear between its samples; e: unit direction
//     s = 1, or stated / recorded range of y
//
// Direction and size are the user's: a marker on the skin tells the course of a breath, not how far the liver goes.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "core/result.h"

namespace teres::phantom {

struct RespirationOptions {
    std::filesystem::path file;       ///< CSV: t_s, then positions [mm], one column per marker and axis
    std::string column;               ///< empty: the one of the largest range
    double amplitude_mm = 0.0;        ///< range of d over the whole record; 0: as recorded
    Point direction{0.0, -1.0, 0.0};  ///< case axes, any length: where growing values move the phantom
};

class Respiration {
  public:
    /// Errors (kInvalidInput): no such column, a value that is no number, times that do not grow or leave a gap above 1
    /// s, a range outside 0.1..200 mm (metres?), a direction of no length, a record shorter than `seconds`: it is not
    /// repeated.
    static Result<Respiration> read(const RespirationOptions& options, double seconds);

    /// Displacement [m] at t [s] after the first sample.
    Point at(double t_s) const;
    const std::string& column() const { return column_; }
    double range_m() const { return range_m_; }  ///< of d over the whole record

  private:
    std::string column_;
    double range_m_ = 0.0;
    std::vector<double> times_;  // from 0 [s]
    std::vector<Point> shifts_;  // [m]
};

}  // namespace teres::phantom
