#include "plugins/dashboard/snapshot.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/case/surface.h"

namespace teres {
namespace {

using nlohmann::json;

constexpr std::int64_t kAugmentedFor_us = 2'000'000;
constexpr std::size_t kMaxDevices = 64;
constexpr double kPerMetre = 1e5, kPerUnit = 1e3;  // places and probabilities go out rounded to 0.01 mm and 0.001

// JSON has no NaN.
json number(double value) {
    return std::isfinite(value) ? json(value) : json();
}
json rounded(double value, double per_unit) {
    return number(std::round(value * per_unit) / per_unit);
}
json numbers(const std::vector<double>& values) {
    json list = json::array();
    for (const double value : values) list.push_back(number(value));
    return list;
}
double seconds(std::int64_t us) {
    return 1e-6 * static_cast<double>(us);
}

json parameters(const boundary_estimate_t& m) {
    json list = json::array();
    for (std::size_t i = 0; i < m.name.size(); ++i)
        list.push_back({{"name", m.name[i]},
                        {"unit", m.unit[i]},
                        {"mean", number(m.mean[i])},
                        {"stdev", number(m.stdev[i])},
                        {"observability", number(m.observability[i])}});
    return list;
}

json attachment(const boundary_estimate_t& m) {
    json list = json::array();
    for (std::size_t i = 0; i < m.node_id.size(); ++i)
        list.push_back({m.node_id[i], rounded(m.attachment_probability[i], kPerUnit)});
    return list;
}

json markers(const markers_t& m) {
    json list = json::array();
    for (std::size_t i = 0; i < m.marker_id.size(); ++i)
        list.push_back({{"id", m.marker_id[i]},
                        {"x_mm", number(1e3 * m.x_m[i])},
                        {"y_mm", number(1e3 * m.y_m[i])},
                        {"z_mm", number(1e3 * m.z_m[i])},
                        {"sigma_mm", number(1e3 * m.sigma_m[i])}});
    return list;
}

json gap(const gap_t& g, const innovation_t& i) {
    return {{"alarm", g.alarm != 0},
            {"kind", g.kind},
            {"onset_s", seconds(g.onset_stamp_us)},
            {"statistic", number(g.statistic)},
            {"bound", number(g.bound)},
            {"center_mm", {number(1e3 * g.center_x_m), number(1e3 * g.center_y_m), number(1e3 * g.center_z_m)}},
            {"nis_ratio", i.degrees_of_freedom > 0 ? number(i.nis / i.degrees_of_freedom) : json()}};
}

json health(const health_t& m) {
    json units = json::array(), channels = json::array();
    for (const unit_health_t& u : m.units)
        units.push_back({{"unit", u.unit},
                         {"state", u.state},
                         {"step_ms", number(u.step_ms_mean)},
                         {"degraded", u.degraded_steps}});
    for (const channel_health_t& c : m.channels)
        channels.push_back(
            {{"channel", c.channel}, {"rate_hz", number(c.rate_hz)}, {"received", c.received}, {"dropped", c.dropped}});
    return {{"uptime_s", number(m.uptime_s)},
            {"memory_mb", number(m.resident_memory_mb)},
            {"loop_ms_max", number(m.loop_ms_max)},
            {"units", units},
            {"channels", channels}};
}

json devices(const std::map<std::string, device_health_t>& all) {
    json list = json::array();
    for (const auto& [name, d] : all)
        list.push_back({{"device", name},
                        {"state", d.state},
                        {"detail", d.detail},
                        {"rate_hz", number(d.rate_hz)},
                        {"lost", d.lost}});
    return list;
}

}  // namespace

Snapshot::Snapshot(const Case& c, std::size_t history) : history_(history) {
    const Surface surface(c.mesh);
    std::map<std::int32_t, std::size_t> place;
    json nodes = json::array(), triangles = json::array();
    for (const std::int32_t node : surface.nodes()) {
        place[node] = place.size();
        surface_nodes_.push_back(static_cast<std::size_t>(node));
        for (const double v : c.mesh.nodes[static_cast<std::size_t>(node)]) nodes.push_back(rounded(v, kPerMetre));
    }
    for (const auto& triangle : surface.triangles())
        for (const std::int32_t node : triangle) triangles.push_back(place[node]);
    mesh_ = json{{"case", c.name}, {"ids", surface.nodes()}, {"nodes", nodes}, {"triangles", triangles}}.dump();
}

void Snapshot::take(const boundary_estimate_t& m) {
    const std::scoped_lock lock(mutex_);
    newest_.estimate = m;
    newest_.curves.push_back({seconds(m.header.capture_stamp_us), m.mean, m.stdev});
    if (newest_.curves.size() > history_) newest_.curves.pop_front();
}

void Snapshot::take(const markers_t& m) {
    const std::scoped_lock lock(mutex_);
    newest_.markers = m;
}

void Snapshot::take(const innovation_t& m) {
    const std::scoped_lock lock(mutex_);
    newest_.innovation = m;
}

void Snapshot::take(const gap_t& m) {
    const std::scoped_lock lock(mutex_);
    newest_.gap = m;
}

void Snapshot::take(const liver_state_t& m) {
    const auto holds = [&](std::size_t n) { return n < m.x_m.size(); };
    if (!std::all_of(surface_nodes_.begin(), surface_nodes_.end(), holds)) return;  // of another mesh
    const std::scoped_lock lock(mutex_);
    newest_.nodes_m.clear();
    for (const std::size_t n : surface_nodes_)
        for (const float v : {m.x_m[n], m.y_m[n], m.z_m[n]}) newest_.nodes_m.push_back(v);
}

void Snapshot::take(const health_t& m) {
    const std::scoped_lock lock(mutex_);
    newest_.health = m;
}

void Snapshot::take(const device_health_t& m) {
    const std::scoped_lock lock(mutex_);
    if (newest_.devices.contains(m.device) || newest_.devices.size() < kMaxDevices) newest_.devices[m.device] = m;
}

void Snapshot::take(const image_t& m, bool augmented) {
    if (m.fourcc != "MJPG") return;
    const std::scoped_lock lock(mutex_);
    if (augmented) augmented_us_ = m.header.capture_stamp_us;
    const bool replaced = augmented_us_ >= 0 && std::abs(m.header.capture_stamp_us - augmented_us_) < kAugmentedFor_us;
    if (augmented || !replaced) image_.assign(m.data.begin(), m.data.end());
}

Snapshot::Newest Snapshot::newest() const {
    const std::scoped_lock lock(mutex_);
    return newest_;
}

std::string Snapshot::image() const {
    const std::scoped_lock lock(mutex_);
    return image_;
}

std::string Snapshot::state() const {
    const Newest now = newest();
    json t = json::array(), means = json::array(), stdevs = json::array(), nodes = json::array();
    for (const Curve& curve : now.curves) {
        t.push_back(curve.t_s);
        means.push_back(numbers(curve.mean));
        stdevs.push_back(numbers(curve.stdev));
    }
    for (const float v : now.nodes_m) nodes.push_back(rounded(v, kPerMetre));
    const json state = {{"t_s", seconds(now.estimate.header.capture_stamp_us)},
                        {"stale", now.curves.empty() || now.estimate.stale != 0},
                        {"parameters", parameters(now.estimate)},
                        {"curves", {{"t_s", t}, {"mean", means}, {"stdev", stdevs}}},
                        {"attachment", attachment(now.estimate)},
                        {"nodes_m", nodes},
                        {"markers", markers(now.markers)},
                        {"gap", gap(now.gap, now.innovation)},
                        {"health", health(now.health)},
                        {"devices", devices(now.devices)}};
    return state.dump(-1, ' ', false, json::error_handler_t::replace);  // texts from the bus may be no UTF-8
}

}  // namespace teres
