// What the dashboard shows. The loop leaves the newest messages here; the server's threads make text of copies.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "core/case/case.h"
#include "teres/boundary_estimate_t.hpp"
#include "teres/device_health_t.hpp"
#include "teres/gap_t.hpp"
#include "teres/health_t.hpp"
#include "teres/image_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"

namespace teres {

class Snapshot {
  public:
    /// history: frames of the parameter curves
    Snapshot(const Case& c, std::size_t history);

    // [loop] Under a lock that is only ever held for a copy.
    void take(const boundary_estimate_t& m);
    void take(const markers_t& m);
    void take(const innovation_t& m);
    void take(const gap_t& m);
    void take(const liver_state_t& m);
    void take(const health_t& m);
    void take(const device_health_t& m);
    /// Only compressed images; an augmented one is preferred as long as it comes.
    void take(const image_t& m, bool augmented);

    // any thread
    std::string state() const;  ///< JSON, see state() in snapshot.cpp
    std::string mesh() const {
        return mesh_;
    }  ///< JSON {case, ids, nodes: [x, y, z, ...], triangles: [a, b, c, ...]} of the surface at rest
    std::string image() const;  ///< JPEG; empty: none yet

  private:
    struct Curve {
        double t_s;
        std::vector<double> mean, stdev;
    };
    struct Newest {
        boundary_estimate_t estimate{};
        markers_t markers{};
        innovation_t innovation{};
        gap_t gap{};
        health_t health{};
        std::map<std::string, device_health_t> devices;
        std::vector<float> nodes_m;  // of the surface
        std::deque<Curve> curves;
    };
    Newest newest() const;

    std::size_t history_;
    std::string mesh_;
    std::vector<std::size_t> surface_nodes_;
    mutable std::mutex mutex_;  // of all below
    Newest newest_;
    std::string image_;
    std::int64_t augmented_us_ = -1;
};

}  // namespace teres
