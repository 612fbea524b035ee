#include "drivers/replay/case_stream.h"

#include <algorithm>
#include <cmath>

namespace teres {

CaseStream::CaseStream(const Case& from)
    : frame_id_(from.name), sigma_m_(from.sensor.noise_sigma_m), rows_(from.observations), loads_(from) {
    for (std::size_t row = 0; row < rows_.size(); ++row) {
        if (frames_.empty() || frames_.back().t_s != rows_[row].t_s) frames_.push_back({rows_[row].t_s, row, row});
        frames_.back().end = row + 1;
    }
}

Result<std::unique_ptr<CaseStream>> CaseStream::make(const Case& from) {
    std::unique_ptr<CaseStream> stream(new CaseStream(from));
    const auto& frames = stream->frames_;
    if (frames.empty())
        return invalid_input((from.folder / "observations.csv").string() + ": no observation, nothing to replay");
    std::vector<double> steps_s{from.dt_s};
    for (std::size_t i = 1; i < frames.size(); ++i) steps_s.push_back(frames[i].t_s - frames[i - 1].t_s);
    std::nth_element(steps_s.begin(), steps_s.begin() + static_cast<std::ptrdiff_t>(steps_s.size() / 2), steps_s.end());
    const double period_s = frames.back().t_s - frames.front().t_s + steps_s[steps_s.size() / 2];
    stream->period_us_ = std::max<std::int64_t>(1, std::llround(period_s * 1e6));
    return stream;
}

std::int64_t CaseStream::stamp_us(std::size_t frame) const {
    return std::llround(frames_[frame].t_s * 1e6) + offset_us_;
}

bool CaseStream::next(Packet& packet) {
    if (frame_ == frames_.size()) return false;
    const Frame& frame = frames_[frame_];
    header_t header;
    header.capture_stamp_us = stamp_us(frame_);
    header.sequence = sequence_;
    header.frame_id = frame_id_;
    if (!loads_done_ && !loads_.empty()) {
        tool_loads_.header = header;
        loads_.at(frame.t_s, tool_loads_);
        encode(tool_loads_, kToolLoadsChannel, packet);
        loads_done_ = true;
        return true;
    }
    const std::size_t count = frame.end - frame.begin;
    markers_.header = header;
    markers_.num_markers = static_cast<std::int32_t>(count);
    markers_.marker_id.resize(count);
    markers_.sigma_m.assign(count, sigma_m_);
    for (auto* component : {&markers_.x_m, &markers_.y_m, &markers_.z_m}) component->resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        const PositionSample& row = rows_[frame.begin + i];
        markers_.marker_id[i] = row.id;
        markers_.x_m[i] = row.position_m[0];
        markers_.y_m[i] = row.position_m[1];
        markers_.z_m[i] = row.position_m[2];
    }
    encode(markers_, kMarkersChannel, packet);
    loads_done_ = false;
    ++frame_;
    ++sequence_;
    return true;
}

void CaseStream::loop() {
    frame_ = 0;
    offset_us_ += period_us_;
}

}  // namespace teres
