// What TOOL_LOADS said, in the order of the forward model: forces per region and tool points, by time.
//
// A frame is computed with the newest loads that are not newer than it; regions that a message leaves out
// carry no force, tools that it leaves out are detached.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "core/extensions/forward_model.h"
#include "teres/tool_loads_t.hpp"

namespace teres {

class LoadBook {
  public:
    /// capacity: samples kept, >= 1.
    explicit LoadBook(const ForwardModel& model, std::size_t capacity = 256);

    enum class Entry { kTaken, kNotFinite, kOlderThanNewest };
    /// [loop] A force that is not finite or a stamp before the newest refuses the message. Names that the
    /// model does not know are counted and passed over.
    Entry add(const tool_loads_t& message);

    /// [loop] Loads at that time; zero (tools detached) before the first message. The spans are valid until
    /// the next add().
    ForwardInputs at(std::int64_t stamp_us) const;

    bool empty() const { return samples_.empty(); }
    std::int64_t newest_us() const { return samples_.empty() ? 0 : samples_.back().stamp_us; }
    std::int64_t num_unknown() const { return num_unknown_; }
    const std::string& first_unknown() const { return first_unknown_; }

  private:
    struct Sample {
        std::int64_t stamp_us = 0;
        std::vector<double> force_n, tool_m;
    };
    std::vector<std::string> regions_, tools_;
    Sample none_;
    std::deque<Sample> samples_;  // oldest first
    std::size_t capacity_;
    std::int64_t num_unknown_ = 0;
    std::string first_unknown_;
};

}  // namespace teres
