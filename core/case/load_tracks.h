// Loads and tool points of a case as functions of time.
//
//     F(t) = F_k + w (F_{k+1} - F_k),   w = (t - t_k) / (t_{k+1} - t_k)        between the samples around t
//
// Before the first sample and after the last one the nearest sample holds; a region without samples carries
// no force, a tool without samples is detached (NaN). A tool that is detached at one of the two samples is
// detached between them.
#pragma once

#include <vector>

#include "core/case/case.h"
#include "teres/tool_loads_t.hpp"

namespace teres {

class LoadTracks {
  public:
    explicit LoadTracks(const Case& from);
    bool empty() const { return message_.num_regions == 0 && message_.num_tools == 0; }
    /// [loop] Fills everything but the header.
    void at(double t_s, tool_loads_t& message) const;

  private:
    struct Track {
        std::vector<double> t_s;
        std::vector<Point> value;
        Point at(double t_s, const Point& otherwise) const;
    };
    std::vector<Track> regions_, tools_;
    tool_loads_t message_;  // names and sizes
};

}  // namespace teres
