// The clock of everything live: monotonic, the base of capture stamps.
#pragma once

#include <ctime>

#include <cstdint>

namespace teres {

/// [loop] CLOCK_MONOTONIC in microseconds.
inline std::int64_t monotonic_us() noexcept {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<std::int64_t>(now.tv_sec) * 1'000'000 + now.tv_nsec / 1'000;
}

}  // namespace teres
