// Names of recordings and windows by the local time.
#pragma once

#include <ctime>
#include <filesystem>

namespace teres {

/// [setup] strftime over the whole path with the local time: session-%Y%m%d-%H%M%S.lcm; unchanged if it gets too long.
inline std::filesystem::path dated(const std::filesystem::path& pattern) {
    const std::time_t now = std::time(nullptr);
    std::tm local{};
    localtime_r(&now, &local);
    char text[4096];
    return std::strftime(text, sizeof text, pattern.c_str(), &local) > 0 ? std::filesystem::path(text) : pattern;
}

}  // namespace teres
