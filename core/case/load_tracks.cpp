#include "core/case/load_tracks.h"

#include <algorithm>
#include <limits>

namespace teres {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace

LoadTracks::LoadTracks(const Case& from) : regions_(from.load_regions.size()) {
    for (const LoadRegion& region : from.load_regions) message_.region.push_back(region.name);
    for (const LoadSample& sample : from.loads) {
        Track& track = regions_.at(static_cast<std::size_t>(sample.region));
        track.t_s.push_back(sample.t_s);
        track.value.push_back(sample.force_n);
    }
    tools_.resize(from.tools.size());
    for (const ToolTie& tool : from.tools) message_.tool.push_back(tool.name);
    for (const ToolSample& sample : from.tool_samples) {
        Track& track = tools_.at(static_cast<std::size_t>(sample.tool));
        track.t_s.push_back(sample.t_s);
        track.value.push_back(sample.position_m);
    }
    message_.num_regions = static_cast<std::int32_t>(regions_.size());
    message_.num_tools = static_cast<std::int32_t>(tools_.size());
    for (auto* component : {&message_.fx_n, &message_.fy_n, &message_.fz_n}) component->resize(regions_.size());
    for (auto* component : {&message_.x_m, &message_.y_m, &message_.z_m}) component->resize(tools_.size());
}

Point LoadTracks::Track::at(double time_s, const Point& otherwise) const {
    if (t_s.empty()) return otherwise;
    const auto above = std::upper_bound(t_s.begin(), t_s.end(), time_s);
    if (above == t_s.begin()) return value.front();
    const auto k = static_cast<std::size_t>(above - t_s.begin()) - 1;
    if (k + 1 == t_s.size() || t_s[k] == time_s) return value[k];  // exact: not spoilt by a NaN that follows
    const double w = (time_s - t_s[k]) / (t_s[k + 1] - t_s[k]);
    Point result;
    for (std::size_t i = 0; i < 3; ++i) result[i] = value[k][i] + w * (value[k + 1][i] - value[k][i]);
    return result;
}

void LoadTracks::at(double t_s, tool_loads_t& message) const {
    const header_t header = message.header;
    message = message_;
    message.header = header;
    for (std::size_t i = 0; i < regions_.size(); ++i) {
        const Point force = regions_[i].at(t_s, {0.0, 0.0, 0.0});
        message.fx_n[i] = force[0];
        message.fy_n[i] = force[1];
        message.fz_n[i] = force[2];
    }
    for (std::size_t i = 0; i < tools_.size(); ++i) {
        const Point position = tools_[i].at(t_s, {kNaN, kNaN, kNaN});
        message.x_m[i] = position[0];
        message.y_m[i] = position[1];
        message.z_m[i] = position[2];
    }
}

}  // namespace teres
