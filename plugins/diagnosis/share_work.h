// Work that two models of the same body do at the same time.
#pragma once

#include <cstddef>
#include <functional>

namespace teres {

/// Calls work(who, k) for every k below `count`: who 0 takes the even ones in order, who 1 the odd ones, in a thread of
/// its own. Not `two`: who 0 takes all. Which state a piece of work meets follows from k alone, so that results do not
/// depend on the machine. What `work` throws is thrown here, after both have ended.
void share_work(bool two, std::size_t count, const std::function<void(std::size_t who, std::size_t k)>& work);

}  // namespace teres
