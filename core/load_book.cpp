#include "core/load_book.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/check.h"

namespace teres {
namespace {

constexpr double kDetached = std::numeric_limits<double>::quiet_NaN();

}  // namespace

LoadBook::LoadBook(const ForwardModel& model, std::size_t capacity) : capacity_(capacity) {
    TERES_CHECK(capacity >= 1);
    for (std::size_t i = 0; i < model.num_regions(); ++i) regions_.emplace_back(model.region_name(i));
    for (std::size_t i = 0; i < model.num_tools(); ++i) tools_.emplace_back(model.tool_name(i));
    none_.force_n.assign(3 * regions_.size(), 0.0);
    none_.tool_m.assign(3 * tools_.size(), kDetached);
}

LoadBook::Entry LoadBook::add(const tool_loads_t& message) {
    if (!samples_.empty() && message.header.capture_stamp_us < samples_.back().stamp_us) return Entry::kOlderThanNewest;
    const auto regions = static_cast<std::size_t>(message.num_regions),
               tools = static_cast<std::size_t>(message.num_tools);
    for (std::size_t i = 0; i < regions; ++i)
        if (!std::isfinite(message.fx_n[i]) || !std::isfinite(message.fy_n[i]) || !std::isfinite(message.fz_n[i]))
            return Entry::kNotFinite;

    Sample sample;
    if (samples_.size() == capacity_) {  // memory of the oldest serves again
        sample = std::move(samples_.front());
        samples_.pop_front();
    }
    sample.force_n = none_.force_n;
    sample.tool_m = none_.tool_m;
    sample.stamp_us = message.header.capture_stamp_us;
    const auto place = [&](const std::vector<std::string>& known, const std::string& name, std::vector<double>& into,
                           double x, double y, double z) {
        const auto found = std::find(known.begin(), known.end(), name);
        if (found == known.end()) {
            if (num_unknown_++ == 0) first_unknown_ = name;
            return;
        }
        double* to = &into[3 * static_cast<std::size_t>(found - known.begin())];
        to[0] = x;
        to[1] = y;
        to[2] = z;
    };
    for (std::size_t i = 0; i < regions; ++i)
        place(regions_, message.region[i], sample.force_n, message.fx_n[i], message.fy_n[i], message.fz_n[i]);
    for (std::size_t i = 0; i < tools; ++i)
        place(tools_, message.tool[i], sample.tool_m, message.x_m[i], message.y_m[i], message.z_m[i]);
    samples_.push_back(std::move(sample));
    return Entry::kTaken;
}

ForwardInputs LoadBook::at(std::int64_t stamp_us) const {
    const Sample* sample = &none_;
    for (auto it = samples_.rbegin(); it != samples_.rend(); ++it)
        if (it->stamp_us <= stamp_us) {
            sample = &*it;
            break;
        }
    ForwardInputs inputs;
    inputs.time_s = 1e-6 * static_cast<double>(stamp_us);
    inputs.region_force_n = sample->force_n;
    inputs.tool_position_m = sample->tool_m;
    return inputs;
}

}  // namespace teres
