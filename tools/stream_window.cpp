#include "tools/stream_window.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_set>
#include <utility>
#include <vector>

namespace teres::tools {
namespace {

constexpr std::size_t kMaxMessages = 100'000;  // of each kind, whatever the rate
constexpr std::size_t kLeastFrames = 8;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double seconds(std::int64_t us) {
    return 1e-6 * static_cast<double>(us);
}

// Index of the name, or -1.
template <class Named>
std::int32_t index_of(const std::vector<Named>& list, const std::string& name) {
    const auto at = std::find_if(list.begin(), list.end(), [&](const Named& n) { return n.name == name; });
    return at == list.end() ? -1 : static_cast<std::int32_t>(at - list.begin());
}

}  // namespace

StreamWindow::StreamWindow(Case base, double length_s)
    : base_(std::move(base)), length_us_(static_cast<std::int64_t>(1e6 * length_s)) {}

void StreamWindow::add(const markers_t& message) {
    const std::int64_t now = message.header.capture_stamp_us;
    if (now < newest_us()) {
        markers_.clear();
        loads_.clear();
    }
    markers_.push_back(message);
    while (now - markers_.front().header.capture_stamp_us > length_us_ || markers_.size() > kMaxMessages)
        markers_.pop_front();
    // The loads that hold at the first frame came before it.
    const std::int64_t first = markers_.front().header.capture_stamp_us;
    while (loads_.size() > 1 && loads_[1].header.capture_stamp_us <= first) loads_.pop_front();
}

void StreamWindow::add(const tool_loads_t& message) {
    if (!loads_.empty() && message.header.capture_stamp_us < loads_.back().header.capture_stamp_us) loads_.clear();
    loads_.push_back(message);
    if (loads_.size() > kMaxMessages) loads_.pop_front();
}

// As the forward model understands them (core/load_book.h): the newest that are not newer than the frame.
void StreamWindow::add_loads(Case& c, std::int64_t stamp_us, double t_s) const {
    const auto after =
        std::find_if(loads_.begin(), loads_.end(), [&](const auto& l) { return l.header.capture_stamp_us > stamp_us; });
    std::vector<Point> force(c.load_regions.size(), Point{}), tool(c.tools.size(), Point{kNaN, kNaN, kNaN});
    if (after != loads_.begin()) {
        const tool_loads_t& l = *std::prev(after);
        for (std::size_t i = 0; i < l.region.size(); ++i)
            if (const auto k = index_of(c.load_regions, l.region[i]); k >= 0)
                force[static_cast<std::size_t>(k)] = {l.fx_n[i], l.fy_n[i], l.fz_n[i]};
        for (std::size_t i = 0; i < l.tool.size(); ++i)
            if (const auto k = index_of(c.tools, l.tool[i]); k >= 0)
                tool[static_cast<std::size_t>(k)] = {l.x_m[i], l.y_m[i], l.z_m[i]};
    }
    for (std::size_t k = 0; k < force.size(); ++k) c.loads.push_back({t_s, static_cast<std::int32_t>(k), force[k]});
    for (std::size_t k = 0; k < tool.size(); ++k)
        c.tool_samples.push_back({t_s, static_cast<std::int32_t>(k), tool[k]});
}

Result<Case> StreamWindow::cut(std::int64_t from_us, std::size_t max_frames) const {
    const auto first = std::find_if(markers_.begin(), markers_.end(),
                                    [&](const auto& m) { return m.header.capture_stamp_us >= from_us; });
    const auto all = static_cast<std::size_t>(markers_.end() - first);
    if (all < kLeastFrames)
        return not_usable("the window holds " + std::to_string(all) + " marker frames, a diagnosis needs at least " +
                          std::to_string(kLeastFrames));
    const std::size_t stride = base_.quasi_static ? (all + max_frames - 1) / max_frames : 1;
    Case c = base_;
    c.observations.clear();
    c.loads.clear();
    c.tool_samples.clear();
    c.stream.clear();
    std::unordered_set<std::int32_t> known;
    for (const MarkerRest& marker : c.markers) known.insert(marker.id);
    const std::int64_t begin_us = first->header.capture_stamp_us;
    c.num_frames = 0;
    double t_s = 0.0;
    for (std::size_t k = 0; k < all; k += stride) {
        const markers_t& m = first[static_cast<std::ptrdiff_t>(k)];
        if (k > 0 && seconds(m.header.capture_stamp_us - begin_us) <= t_s) continue;  // a stamp that came twice
        t_s = seconds(m.header.capture_stamp_us - begin_us);
        std::unordered_set<std::int32_t> missing = known;
        for (std::size_t i = 0; i < m.marker_id.size(); ++i)
            if (missing.erase(m.marker_id[i]) == 1)
                c.observations.push_back({t_s, m.marker_id[i], {m.x_m[i], m.y_m[i], m.z_m[i]}});
        for (const MarkerRest& marker : c.markers)
            if (missing.contains(marker.id)) c.observations.push_back({t_s, marker.id, {kNaN, kNaN, kNaN}});
        add_loads(c, m.header.capture_stamp_us, t_s);
        ++c.num_frames;
    }
    c.dt_s = c.num_frames > 1 ? t_s / (c.num_frames - 1) : base_.dt_s;
    return c;
}

}  // namespace teres::tools
