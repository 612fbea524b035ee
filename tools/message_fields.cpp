#include "tools/message_fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "teres/boundary_estimate_t.hpp"
#include "teres/camera_info_t.hpp"
#include "teres/cut_t.hpp"
#include "teres/device_health_t.hpp"
#include "teres/gap_t.hpp"
#include "teres/health_t.hpp"
#include "teres/image_t.hpp"
#include "teres/innovation_t.hpp"
#include "teres/liver_state_t.hpp"
#include "teres/markers_t.hpp"
#include "teres/pedal_t.hpp"
#include "teres/registration_t.hpp"
#include "teres/surface_points_t.hpp"
#include "teres/tool_loads_t.hpp"
#include "teres/tracking_t.hpp"

namespace teres::tools {
namespace {

using nlohmann::json;
constexpr std::size_t kShown = 8;  // elements of an array

template <class T>
json head(const std::vector<T>& all) {
    json shown = json::array();
    for (std::size_t i = 0; i < std::min(all.size(), kShown); ++i) shown.push_back(all[i]);
    return shown;
}

void put(json& to, const header_t& header) {
    to["capture_stamp_us"] = header.capture_stamp_us;
    to["sequence"] = header.sequence;
    to["frame_id"] = header.frame_id;
}

void put(json& to, const markers_t& m) {
    put(to, m.header);
    to["num_markers"] = m.num_markers;
    to["lost"] = std::count_if(m.x_m.begin(), m.x_m.end(), [](double x) { return std::isnan(x); });
    to["marker_id"] = head(m.marker_id);
    to["x_m"] = head(m.x_m);
    to["y_m"] = head(m.y_m);
    to["z_m"] = head(m.z_m);
    to["sigma_m"] = head(m.sigma_m);
}

void put(json& to, const tool_loads_t& m) {
    put(to, m.header);
    to["region"] = head(m.region);
    to["fx_n"] = head(m.fx_n);
    to["fy_n"] = head(m.fy_n);
    to["fz_n"] = head(m.fz_n);
    to["tool"] = head(m.tool);
    to["x_m"] = head(m.x_m);
    to["y_m"] = head(m.y_m);
    to["z_m"] = head(m.z_m);
}

void put(json& to, const cut_t& m) {
    put(to, m.header);
    to["num_tets"] = m.num_tets;
    to["tet"] = head(m.tet);
    to["released"] = head(m.released);
}

void put(json& to, const registration_t& m) {
    put(to, m.header);
    to["camera"] = m.camera;
    to["good"] = m.good != 0;
    if (!m.reason.empty()) to["reason"] = m.reason;
    to["translation_m"] = {m.translation_m[0], m.translation_m[1], m.translation_m[2]};
    for (std::size_t i = 0; i < 3; ++i) {
        to["turn_stdev_rad"].push_back(std::sqrt(m.covariance[7 * i]));
        to["shift_stdev_m"].push_back(std::sqrt(m.covariance[7 * (i + 3)]));
    }
    to["rms_m"] = m.rms_m;
    to["points"] = m.points;
    to["markers"] = m.markers;
}

void put(json& to, const surface_points_t& m) {
    put(to, m.header);
    to["num_points"] = m.num_points;
    to["features"] = std::count_if(m.feature_id.begin(), m.feature_id.end(), [](int id) { return id >= 0; });
    to["x_m"] = head(m.x_m);
    to["y_m"] = head(m.y_m);
    to["z_m"] = head(m.z_m);
    to["sigma_m"] = head(m.sigma_m);
}

void put(json& to, const tracking_t& m) {
    put(to, m.header);
    to["frames"] = m.frames;
    to["tracked"] = std::count_if(m.status.begin(), m.status.end(), [](int s) { return s > 0; });
    to["num_markers"] = m.num_markers;
    to["latency_s"] = m.latency_s;
    to["clock_drift_ppm"] = m.clock_drift_ppm;
    json faults = json::object();
    for (std::size_t i = 0; i < m.fault.size(); ++i) faults[m.fault[i]] = m.fault_frames[i];
    to["faults"] = faults;
    to["swaps"] = m.swaps;
    to["rejected"] = m.rejected;
}

void put(json& to, const boundary_estimate_t& m) {
    put(to, m.header);
    to["stale"] = m.stale != 0;
    to["num_parameters"] = m.num_parameters;
    to["name"] = head(m.name);
    to["unit"] = head(m.unit);
    to["mean"] = head(m.mean);
    to["stdev"] = head(m.stdev);
    to["observability"] = head(m.observability);
    to["num_nodes"] = m.num_nodes;
    to["attached_nodes"] = std::count_if(m.attachment_probability.begin(), m.attachment_probability.end(),
                                         [](double p) { return p > 0.5; });
}

void put(json& to, const liver_state_t& m) {
    put(to, m.header);
    to["stale"] = m.stale != 0;
    to["converged"] = m.converged != 0;
    to["relative_residual"] = m.relative_residual;
    to["num_nodes"] = m.num_nodes;
}

void put(json& to, const innovation_t& m) {
    put(to, m.header);
    to["nis"] = m.nis;
    to["degrees_of_freedom"] = m.degrees_of_freedom;
    double squares = 0.0;
    int used = 0, gated = 0;
    for (std::size_t i = 0; i < m.used.size(); ++i) {
        gated += m.used[i] < 0 ? 1 : 0;
        if (m.used[i] <= 0) continue;
        ++used;
        squares += m.dx_m[i] * m.dx_m[i] + m.dy_m[i] * m.dy_m[i] + m.dz_m[i] * m.dz_m[i];
    }
    to["num_markers"] = m.num_markers;
    to["used"] = used;
    to["gated"] = gated;
    to["rms_m"] = used > 0 ? std::sqrt(squares / used) : 0.0;
}

void put(json& to, const gap_t& m) {
    put(to, m.header);
    to["alarm"] = m.alarm != 0;
    to["kind"] = m.kind;
    to["onset_stamp_us"] = m.onset_stamp_us;
    to["statistic"] = m.statistic;
    to["bound"] = m.bound;
    to["center_m"] = {m.center_x_m, m.center_y_m, m.center_z_m};
    to["radius_m"] = m.radius_m;
    to["num_markers"] = m.num_markers;
}

void put(json& to, const health_t& m) {
    put(to, m.header);
    to["uptime_s"] = m.uptime_s;
    to["resident_memory_mb"] = m.resident_memory_mb;
    to["loop_ms_max"] = m.loop_ms_max;
    json units = json::object();
    for (const unit_health_t& unit : m.units)
        units[unit.unit] = {
            {"state", unit.state}, {"step_ms_mean", unit.step_ms_mean}, {"degraded", unit.degraded_steps}};
    to["units"] = units;
    std::int64_t dropped = 0;
    for (const channel_health_t& channel : m.channels) dropped += channel.dropped;
    to["dropped"] = dropped;
}

void put(json& to, const image_t& m) {
    put(to, m.header);
    to["serial"] = m.serial;
    to["fourcc"] = m.fourcc;
    to["width_px"] = m.width_px;
    to["height_px"] = m.height_px;
    to["num_bytes"] = m.num_bytes;
}

void put(json& to, const camera_info_t& m) {
    put(to, m.header);
    to["serial"] = m.serial;
    to["width_px"] = m.width_px;
    to["height_px"] = m.height_px;
    to["fx_px"] = m.fx_px;
    to["fy_px"] = m.fy_px;
    to["cx_px"] = m.cx_px;
    to["cy_px"] = m.cy_px;
    to["depth_unit_m"] = m.depth_unit_m;
    to["baseline_m"] = m.baseline_m;
}

void put(json& to, const device_health_t& m) {
    put(to, m.header);
    to["device"] = m.device;
    to["state"] = m.state;
    to["serial"] = m.serial;
    to["detail"] = m.detail;
    to["age_s"] = m.age_s;
    to["rate_hz"] = m.rate_hz;
    to["received"] = m.received;
    to["lost"] = m.lost;
    to["damaged"] = m.damaged;
    to["recoveries"] = m.recoveries;
    to["usb_mbps"] = m.usb_mbps;
    to["temperature_c"] = m.temperature_c;
}

void put(json& to, const pedal_t& m) {
    put(to, m.header);
    to["pedal"] = m.pedal;
    to["down"] = m.down != 0;
    to["action"] = m.action;
}

struct Type {
    std::string name;
    std::function<json(const void* data, int size)> decode;
};

template <class Message>
std::pair<const std::int64_t, Type> known() {
    return {Message::getHash(), {std::string("teres.") + Message::getTypeName(), [](const void* data, int size) {
                                     Message message;
                                     json values;
                                     if (message.decode(data, 0, size) >= 0) put(values, message);
                                     return values;
                                 }}};
}

std::string text_of(const json& value) {
    if (value.is_number_float()) return fmt::format("{:.4g}", value.get<double>());
    if (value.is_string()) return printable(value.get<std::string>());
    if (value.is_array()) {
        std::string text = "[";
        for (const json& element : value) text += (text.size() > 1 ? " " : "") + text_of(element);
        return text + "]";
    }
    if (value.is_object()) return "{" + one_line(value) + "}";
    return value.dump();
}

}  // namespace

MessageFields message_fields(std::span<const std::uint8_t> data) {
    static const std::map<std::int64_t, Type> types = {known<boundary_estimate_t>(),
                                                       known<gap_t>(),
                                                       known<health_t>(),
                                                       known<innovation_t>(),
                                                       known<liver_state_t>(),
                                                       known<markers_t>(),
                                                       known<tool_loads_t>(),
                                                       known<image_t>(),
                                                       known<camera_info_t>(),
                                                       known<device_health_t>(),
                                                       known<pedal_t>(),
                                                       known<tracking_t>(),
                                                       known<cut_t>(),
                                                       known<registration_t>(),
                                                       known<surface_points_t>()};
    MessageFields fields;
    if (data.size() < 8) return fields;
    std::uint64_t hash = 0;
    for (std::size_t i = 0; i < 8; ++i) hash = hash << 8 | data[i];
    const auto type = types.find(static_cast<std::int64_t>(hash));
    if (type == types.end()) {
        fields.type = fmt::format("0x{:016x}", hash);
        return fields;
    }
    fields.type = type->second.name;
    fields.values = type->second.decode(data.data(), static_cast<int>(data.size()));
    return fields;
}

std::string one_line(const json& values) {
    std::string text;
    for (const auto& [key, value] : values.items())
        text += (text.empty() ? "" : " ") + printable(key) + "=" + text_of(value);
    return text;
}

std::string printable(std::string_view text) {
    std::string safe(text);
    for (char& c : safe)
        if (c < ' ' || c > '~') c = '?';
    return safe;
}

}  // namespace teres::tools
